//! Geometry of the arm.

use nalgebra::{Matrix3, Vector3};

use super::Vector;
use super::files::{Facets, drawn};
use super::hull::single;
use super::mesh::{Mesh, Vertex, across};
use super::paint::Paint;
use crate::description::{Body, Joint, JointKind, Parent, Scene, Water};
use crate::system::{EndEffector, JOINTS, Joints};

const LINK: Paint = Paint::new(0xD9DCDD).glossy(0.3);
const JOINT: Paint = Paint::new(0x363C45).glossy(0.3);
const RING: Paint = Paint::new(0xF07A22).glossy(0.3);
const FINGER: Paint = Paint::new(0x4A525C).glossy(0.4);
const PAYLOAD: Paint = Paint::new(0xA8483A).glossy(0.1);
/// Colour of the end effector, used for nothing else.
pub const TIP: Paint = Paint::new(0xFF2FD0).glowing(1.0);
/// Density by which payloads are drawn, kg/m3.
const PAYLOAD_DENSITY: f64 = 2500.0;

/// Drawing of the arm.
#[derive(Debug)]
pub struct ArmModel {
    /// The arm's base, then the links.
    links: Vec<DrawnLink>,
    tip: EndEffector,
    /// Entry that carries the end effector.
    tip_link: Option<usize>,
    /// End effectors at entries that carry nothing else, each drawn as a gripper.
    grippers: Vec<(usize, EndEffector)>,
    /// Number of moving bodies, the vehicle included.
    bodies: usize,
    /// Mass of the scene's payload, kg.
    payload: f64,
}

/// The arm's base or a link.
#[derive(Debug)]
struct DrawnLink {
    frame: EndEffector,
    /// Axis in the link's frame, and true if the joint is prismatic; none where it is fixed to its parent.
    axis: Option<(Vector3<f64>, bool)>,
    /// Entries that it carries.
    carries: Vec<usize>,
    /// End in its frame, m, by its centre of mass; drawn where it carries nothing, no end effector either.
    end: Option<Vector3<f64>>,
    radius: f32,
    /// Mesh of its files, in its frame, in place of its drawing.
    mesh: Option<Mesh>,
}

impl DrawnLink {
    fn new(frame: EndEffector, joint: Option<&Joint>, body: Option<&Body>, mesh: Option<Mesh>) -> Self {
        let axis = joint.filter(|joint| joint.kind != JointKind::Fixed);
        let axis = axis.map(|joint| (joint.axis, joint.slides()));
        let end = body.map(|body| body.center_of_mass * 2.0);
        Self { frame, axis, carries: Vec::new(), end, radius: 0.03, mesh }
    }
}

impl ArmModel {
    /// The arm of a scene, if it has one.
    pub fn new(scene: &Scene, facets: &Facets) -> Option<Self> {
        let arm = scene.arm.as_ref()?;
        let bodies: Vec<_> =
            std::iter::once(arm.base.as_ref()).chain(arm.links.iter().map(|l| l.body.as_ref())).collect();
        let joints = std::iter::once(arm.mount.joint.as_ref()).chain(arm.links.iter().map(|link| Some(&link.joint)));
        let files = std::iter::once(&arm.meshes).chain(arm.links.iter().map(|link| &link.meshes));
        let meshes = files.map(|files| drawn(files, facets, LINK));
        let links = EndEffector::links(scene).into_iter().zip(joints).zip(&bodies).zip(meshes);
        let mut links: Vec<_> =
            links.map(|(((frame, joint), body), mesh)| DrawnLink::new(frame, joint, *body, mesh)).collect();
        let entry = |of| match of {
            Some(Parent::Link(k)) => Some(1 + k),
            Some(Parent::Base) => Some(0),
            Some(Parent::Vehicle) | None => None,
        };
        for i in 0..arm.links.len() {
            if let Some(parent) = entry(arm.parent(i)) {
                links[parent].carries.push(1 + i);
            }
        }
        let payload = scene.payload.as_ref().map_or(0.0, |p| p.body.mass);
        let (tip, tip_link, count) =
            (EndEffector::new(scene), entry(arm.carrier(&arm.end_effector)), 1 + scene.joints().count());
        let names = scene.end_effector_names().into_iter().filter_map(|name| scene.with_end_effector(&name).ok());
        let others = names.filter_map(|scene| {
            let arm = scene.arm.as_ref()?;
            Some((entry(arm.carrier(&arm.end_effector))?, EndEffector::new(&scene)))
        });
        let mut grippers: Vec<(usize, EndEffector)> = Vec::new();
        for (i, end_effector) in tip_link.map(|i| (i, tip.clone())).into_iter().chain(others) {
            if links[i].carries.is_empty() && grippers.iter().all(|(k, _)| *k != i) {
                grippers.push((i, end_effector));
            }
        }
        let mut this = Self { links, tip, tip_link, grippers, bodies: count, payload };
        // Lengths of links depend on prismatic joints only.
        let (points, end) = this.points(&scene.home());
        let moves = |i: &usize| this.links[*i].axis.is_some();
        let longest = |i: usize| {
            let gripper = this.gripper(i, &scene.home()).map(|(_, tip)| tip);
            let tip = (tip_link == Some(i)).then_some(end.1).or(gripper);
            let ends = this.ends(i, &points, &scene.home()).into_iter().chain(tip);
            ends.map(|end| (end - points[i]).norm()).fold(0.0, f32::max)
        };
        let lengths: Vec<_> = (0..points.len()).filter(moves).map(|i| (i, longest(i))).collect();
        let total = lengths.iter().map(|(_, length)| length).sum::<f32>() + (end.1 - points[0]).norm() * 1e-3;
        for (i, length) in &lengths {
            let Some(body) = bodies[*i] else { continue };
            this.links[*i].radius = radius(body, &scene.water, *length, total);
        }
        // Fingers beside each other stay apart.
        for parent in 0..points.len() {
            let fingers = this.links[parent].carries.clone();
            for (i, k) in fingers.iter().enumerate().flat_map(|(n, i)| fingers[n + 1..].iter().map(move |k| (*i, *k))) {
                let thickest = 0.4 * (points[i] - points[k]).norm();
                for finger in [i, k].into_iter().filter(|_| thickest > 0.0) {
                    this.links[finger].radius = this.links[finger].radius.min(thickest);
                }
            }
        }
        // Parts of a moving link are as thick as it, parts of the vehicle as the first moving link.
        for i in 0..points.len() {
            let body = this.links[i].frame.body();
            let alike = |k: &&(usize, f32)| body == 0 || this.links[k.0].frame.body() == body;
            if let (None, Some((k, _))) = (this.links[i].axis, lengths.iter().find(alike)) {
                this.links[i].radius = this.links[*k].radius;
            }
        }
        Some(this)
    }

    /// Origins of the links, and the end effector, in the vehicle frame.
    fn points(&self, q: &Joints) -> (Vec<Vector>, (Matrix3<f64>, Vector)) {
        let (rotation, tip) = self.tip.pose(q);
        (self.links.iter().map(|link| single(&link.frame.pose(q).1)).collect(), (rotation, single(&tip)))
    }

    /// Attitude and end of the gripper on link `i`, if there is one, in the vehicle frame.
    fn gripper(&self, i: usize, q: &Joints) -> Option<(Matrix3<f64>, Vector)> {
        let (_, end_effector) = self.grippers.iter().find(|(k, _)| *k == i)?;
        let (rotation, tip) = end_effector.pose(q);
        Some((rotation, single(&tip)))
    }

    /// Ends of link `i` in the vehicle frame: the links on it, else its own end unless it carries an end effector.
    fn ends(&self, i: usize, points: &[Vector], q: &Joints) -> Vec<Vector> {
        let link = &self.links[i];
        if link.carries.is_empty() && self.grippers.iter().all(|(k, _)| *k != i) {
            let (rotation, position) = link.frame.pose(q);
            return link.end.iter().map(|end| single(&(rotation * end + position))).collect();
        }
        link.carries.iter().map(|&k| points[k]).collect()
    }

    /// Draws the arm in the vehicle frame, with `payload` kg in addition to the scene's: what is fixed to the vehicle, then each moving
    /// link with what is fixed to it. Returns the number of the first vertex of each moving link.
    pub fn draw(&self, mesh: &mut Mesh, q: &[f64], payload: f64) -> Vec<usize> {
        let mut joints = [0.0; JOINTS];
        joints.iter_mut().zip(q).for_each(|(joint, q)| *joint = *q);
        let (points, (_, tip)) = self.points(&joints);
        let mut starts = Vec::with_capacity(self.bodies);
        for body in 0..self.bodies {
            starts.push(mesh.vertices.len());
            for (i, link) in self.links.iter().enumerate().filter(|(_, link)| link.frame.body() == body) {
                let (from, r) = (points[i], link.radius);
                if let Some(own) = &link.mesh {
                    let rotation = link.frame.pose(&joints).0.map(|x| x as f32);
                    let turned = |v: &Vertex| Vertex {
                        position: rotation * v.position + from,
                        normal: rotation * v.normal,
                        ..*v
                    };
                    mesh.append(own, turned);
                    continue;
                }
                if let Some((axis, slides)) = link.axis {
                    let axis = single(&(link.frame.pose(&joints).0 * axis));
                    joint_housing(mesh, from, axis, r, slides);
                }
                let mut ends = self.ends(i, &points, &joints);
                if body == 0 {
                    // A foot at the mount.
                    ends.extend((self.tip_link == Some(i)).then_some(tip));
                    ends.iter().for_each(|to| mesh.capsule(from, *to, 1.05 * r, 16, JOINT));
                    continue;
                }
                ends.iter().for_each(|to| mesh.capsule(from, *to, 0.86 * r, 16, LINK));
                if let Some((attitude, tip)) = self.gripper(i, &joints) {
                    gripper(mesh, from, tip, &attitude, r);
                }
            }
            if body == self.tip.body() {
                self.mark(mesh, &points, tip, payload);
            }
        }
        starts.remove(0);
        starts
    }

    /// Marks the end effector and draws its payload, with `payload` kg in addition to the scene's.
    fn mark(&self, mesh: &mut Mesh, points: &[Vector], tip: Vector, payload: f64) {
        let r = 0.3 * self.tip_link.or((!self.links.is_empty()).then_some(0)).map_or(0.03, |k| self.links[k].radius);
        mesh.ellipsoid(tip, Vector::repeat(r), 12, |_| TIP);
        let load = self.payload + payload;
        if load > 0.0 && load.is_finite() {
            let radius = (load / PAYLOAD_DENSITY * 0.75 / std::f64::consts::PI).cbrt() as f32;
            let from = self.tip_link.filter(|k| self.links[*k].frame.body() > 0).map(|k| points[k]);
            let ahead = from.map_or(-Vector::z(), |from| (tip - from).try_normalize(1e-6).unwrap_or(-Vector::z()));
            mesh.ellipsoid(tip + ahead * (0.9 * radius + r), Vector::repeat(radius), 18, |_| PAYLOAD);
        }
    }

    /// The foot in the vehicle frame, then each link in its frame, with the distances between joints at `q`.
    pub fn bodies(&self, q: &Joints) -> Vec<Mesh> {
        let mut arm = Mesh::default();
        let mut bounds = vec![0];
        bounds.extend(self.draw(&mut arm, q, 0.0));
        bounds.push(arm.vertices.len());
        let vehicle = (Matrix3::identity(), Vector3::zeros());
        let moving = self.links.iter().filter(|link| link.axis.is_some());
        let frames = std::iter::once(vehicle).chain(moving.map(|link| link.frame.pose(q)));
        frames
            .zip(bounds.windows(2))
            .map(|((rotation, position), range)| {
                let (back, origin) = (rotation.transpose().map(|x| x as f32), single(&position));
                let local =
                    |v: &Vertex| Vertex { position: back * (v.position - origin), normal: back * v.normal, ..*v };
                let (first, end) = (range[0] as u32, range[1] as u32);
                let triangles = arm.triangles.iter().filter(|t| (first..end).contains(&t[0]));
                Mesh {
                    vertices: arm.vertices[range[0]..range[1]].iter().map(local).collect(),
                    triangles: triangles.map(|t| t.map(|k| k - first)).collect(),
                }
            })
            .collect()
    }
}

/// The motor of a joint, with a ring on either side, or the beam of a slide.
fn joint_housing(mesh: &mut Mesh, at: Vector, axis: Vector, r: f32, slides: bool) {
    if slides {
        mesh.beam(at - axis * (2.0 * r), at + axis * (2.0 * r), 1.15 * r, JOINT);
        return;
    }
    mesh.cylinder(at - axis * (1.35 * r), at + axis * (1.35 * r), 1.18 * r, 18, JOINT);
    for side in [-1.0, 1.0] {
        let ring = at + axis * (side * 1.35 * r);
        mesh.cylinder(ring - axis * (0.08 * r), ring + axis * (0.08 * r), 0.8 * r, 14, RING);
    }
}

/// Radius of the cylinder of this volume and length, within bounds.
fn radius(body: &Body, water: &Water, length: f32, total: f32) -> f32 {
    let volume = body.displaced_volume(water);
    let volume = if volume > 0.0 { volume } else { body.mass / 1000.0 };
    let length = length.max(0.06 * total).max(1e-3);
    let even = (volume as f32 / (std::f32::consts::PI * length)).sqrt();
    let (minimum, most) = (0.025 * total.max(1e-3), 0.08 * total.max(1e-3));
    even.max(minimum).min(most)
}

/// Two fingers, open towards the end effector.
fn gripper(mesh: &mut Mesh, from: Vector, tip: Vector, attitude: &Matrix3<f64>, r: f32) {
    let reach = tip - from;
    let length = reach.norm();
    if length < 1e-6 {
        return;
    }
    let ahead = reach / length;
    // Fingers rotate with the end effector.
    let aside = (0..3).map(|k| single(&attitude.column(k).into_owned()));
    let aside = aside.map(|e| e - ahead * e.dot(&ahead)).max_by(|a, b| a.norm().total_cmp(&b.norm()));
    let aside = aside.and_then(|e| e.try_normalize(1e-3)).unwrap_or_else(|| across(&ahead)[0]);
    let up = ahead.cross(&aside);
    let palm = from + reach * 0.5;
    mesh.capsule(from, palm, 0.86 * r, 16, LINK);
    mesh.slab(palm, [ahead * (0.35 * r), aside * (1.2 * r), up * (0.6 * r)], JOINT);
    for side in [-1.0, 1.0] {
        let out = aside * side;
        let (root, knee) = (palm + out * (0.85 * r), palm + reach * 0.22 + out * (1.15 * r));
        let nail = from + reach * 0.99 + out * (0.42 * r);
        mesh.beam(root, knee, 0.24 * r, FINGER);
        mesh.capsule(knee, knee, 0.3 * r, 8, JOINT);
        mesh.beam(knee, nail, 0.2 * r, FINGER);
    }
}

//! Geometry of the arm.

use nalgebra::{Matrix3, Vector3};

use super::Vector;
use super::hull::single;
use super::mesh::{Mesh, Vertex, across};
use super::paint::Paint;
use crate::description::{Body, JointKind, Parent, Scene, Water};
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
    /// Position of the mount in the vehicle frame, m.
    mount: Vector,
    /// Link frames.
    links: Vec<EndEffector>,
    /// Axis of each joint in its link's frame, and true if it is prismatic.
    axes: Vec<(Vector3<f64>, bool)>,
    tip: EndEffector,
    /// Link that carries the end effector.
    tip_link: Option<usize>,
    /// Links on the arm's base.
    on_base: Vec<usize>,
    /// Links on each link.
    on_link: Vec<Vec<usize>>,
    /// End of each link in its frame, m, by its centre of mass; drawn where the link carries nothing.
    ends: Vec<Vector3<f64>>,
    /// Radius of each link.
    radii: Vec<f32>,
    /// Mass of the scene's payload, kg.
    payload: f64,
}

impl ArmModel {
    /// The arm of a scene, if it has one.
    pub fn new(scene: &Scene) -> Option<Self> {
        let arm = scene.arm.as_ref()?;
        let (links, tip) = (EndEffector::links(scene), EndEffector::new(scene));
        let joints: Vec<_> = scene.joints().collect();
        let axes = joints.iter().map(|joint| (joint.axis, joint.kind == JointKind::Prismatic)).collect();
        let bodies = arm.base.iter().filter(|_| arm.mount.joint.is_some());
        let bodies: Vec<_> = bodies.chain(arm.links.iter().map(|link| &link.body)).collect();
        let first = bodies.len() - arm.links.len();
        let (mut on_base, mut on_link) = (Vec::from_iter(0..first), vec![Vec::new(); bodies.len()]);
        for i in 0..arm.links.len() {
            match arm.parent(i) {
                Some(Parent::Link(k)) => on_link[first + k].push(first + i),
                Some(Parent::Base) if first > 0 => on_link[0].push(first + i),
                Some(Parent::Base) => on_base.push(i),
                Some(Parent::Vehicle) | None => {}
            }
        }
        let tip_link = match arm.tip() {
            Some(Parent::Link(k)) => Some(first + k),
            Some(Parent::Base) => first.checked_sub(1),
            Some(Parent::Vehicle) | None => None,
        };
        let ends = bodies.iter().map(|body| body.center_of_mass * 2.0).collect();
        let mount = single(&arm.mount.frame.position);
        let payload = scene.payload.as_ref().map_or(0.0, |p| p.body.mass);
        let radii = Vec::new();
        let mut this = Self { mount, links, axes, tip, tip_link, on_base, on_link, ends, radii, payload };
        // Lengths of links depend on prismatic joints only.
        let (points, end) = this.points(&scene.home());
        let longest = |(i, from): (usize, &Vector)| {
            let tip = (tip_link == Some(i)).then_some(end.1);
            let ends = this.ends(i, &points, &scene.home()).into_iter().chain(tip);
            ends.map(|end| (end - from).norm()).fold(0.0, f32::max)
        };
        let lengths: Vec<f32> = points.iter().enumerate().map(longest).collect();
        let total = lengths.iter().sum::<f32>() + (end.1 - this.mount).norm() * 1e-3;
        let radius = |(body, length): (&&Body, &f32)| radius(body, &scene.water, *length, total);
        this.radii = bodies.iter().zip(&lengths).map(radius).collect();
        Some(this)
    }

    /// Origins of the links, and the end effector, in the vehicle frame.
    fn points(&self, q: &Joints) -> (Vec<Vector>, (Matrix3<f64>, Vector)) {
        let (rotation, tip) = self.tip.pose(q);
        (self.links.iter().map(|link| single(&link.pose(q).1)).collect(), (rotation, single(&tip)))
    }

    /// Ends of link `i` in the vehicle frame: the links on it, else its own end unless it carries the end effector.
    fn ends(&self, i: usize, points: &[Vector], q: &Joints) -> Vec<Vector> {
        if self.on_link[i].is_empty() && self.tip_link != Some(i) {
            let (rotation, position) = self.links[i].pose(q);
            return vec![single(&(rotation * self.ends[i] + position))];
        }
        self.on_link[i].iter().map(|&k| points[k]).collect()
    }

    /// Draws the arm in the vehicle frame, with `payload` kg in addition to the scene's: the foot at the mount, then the links. Returns
    /// the number of the first vertex of each link.
    pub fn draw(&self, mesh: &mut Mesh, q: &[f64], payload: f64) -> Vec<usize> {
        let mut joints = [0.0; JOINTS];
        joints.iter_mut().zip(q).for_each(|(joint, q)| *joint = *q);
        let (points, (attitude, tip)) = self.points(&joints);
        let thick = self.radii.first().copied().unwrap_or(0.03);
        // A foot at the mount.
        let tip_on_base = (points.is_empty()).then_some(tip);
        for base in self.on_base.iter().map(|&k| points[k]).chain(tip_on_base) {
            mesh.capsule(self.mount, base, 1.05 * thick, 16, JOINT);
        }
        let mut starts = Vec::with_capacity(points.len());
        for (i, from) in points.iter().enumerate() {
            starts.push(mesh.vertices.len());
            let r = self.radii[i];
            let (rotation, _) = self.links[i].pose(&joints);
            let (axis, slides) = self.axes[i];
            let axis = single(&(rotation * axis));
            if slides {
                mesh.beam(from - axis * (2.0 * r), from + axis * (2.0 * r), 1.15 * r, JOINT);
            } else {
                mesh.cylinder(from - axis * (1.35 * r), from + axis * (1.35 * r), 1.18 * r, 18, JOINT);
                for side in [-1.0, 1.0] {
                    let at = from + axis * (side * 1.35 * r);
                    mesh.cylinder(at - axis * (0.08 * r), at + axis * (0.08 * r), 0.8 * r, 14, RING);
                }
            }
            for to in self.ends(i, &points, &joints) {
                mesh.capsule(*from, to, 0.86 * r, 16, LINK);
            }
            if self.tip_link == Some(i) {
                gripper(mesh, *from, tip, &attitude, r);
            }
        }
        let r = 0.3 * self.tip_link.map_or(thick, |k| self.radii[k]);
        mesh.ellipsoid(tip, Vector::repeat(r), 12, |_| TIP);
        let load = self.payload + payload;
        if load > 0.0 && load.is_finite() {
            let radius = (load / PAYLOAD_DENSITY * 0.75 / std::f64::consts::PI).cbrt() as f32;
            let from = self.tip_link.map(|k| points[k]);
            let ahead = from.map_or(-Vector::z(), |from| (tip - from).try_normalize(1e-6).unwrap_or(-Vector::z()));
            mesh.ellipsoid(tip + ahead * (0.9 * radius + r), Vector::repeat(radius), 18, |_| PAYLOAD);
        }
        starts
    }

    /// The foot in the vehicle frame, then each link in its frame, with the distances between joints at `q`.
    pub fn bodies(&self, q: &Joints) -> Vec<Mesh> {
        let mut arm = Mesh::default();
        let mut bounds = vec![0];
        bounds.extend(self.draw(&mut arm, q, 0.0));
        bounds.push(arm.vertices.len());
        let vehicle = (Matrix3::identity(), Vector3::zeros());
        let frames = std::iter::once(vehicle).chain(self.links.iter().map(|link| link.pose(q)));
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

//! Renderer: pictures of states.

use std::sync::Mutex;

use nalgebra::{Matrix3, Vector3};

use super::Vector;
use super::arm::ArmModel;
use super::backdrop::{self, Caustics, Floor};
use super::camera::Camera;
use super::dock::{dock, has_dock};
use super::files::Facets;
use super::hull::{Envelope, Thruster, hull, single};
use super::marks;
use super::mesh::{Mesh, Vertex};
use super::paint::{Water, display};
use super::raster::{Canvas, Corner};
use super::shadow::Shadow;
use super::spheres::Spheres;
use super::surroundings::{Surroundings, placed};
use crate::description::Scene;
use crate::error::RenderError;
use crate::system::{JOINTS, Joints};

/// Maximum width and height, pixels.
const MAX_PIXELS: usize = 4096;
/// Maximum magnitude of drawn coordinates, m.
pub(super) const FAR: f64 = 1e5;
/// Azimuth of the camera, rad, where nothing hides the scene from there.
const AZIMUTH: f64 = -0.95;
/// Azimuth relative to the camera and elevation of the sun, rad: to the left and high.
const SUN: (f64, f64) = (-0.75, 1.05);

/// Settings of a renderer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Azimuth of the camera relative to its focus, about the vertical from x, rad; None: -0.95, or its mirror image where near
    /// shapes would hide the vehicle.
    pub azimuth: Option<f64>,
    /// Elevation of the camera above the horizontal, rad.
    pub elevation: f64,
    /// Distance of the camera, m; None: by the size of what the picture shows.
    pub distance: Option<f64>,
    /// Height of the floor, m; None: the scene's highest level plane, else below the scene at the origin.
    pub floor: Option<f64>,
}

impl Default for Settings {
    fn default() -> Self {
        Self { size: [640, 480], azimuth: None, elevation: 0.32, distance: None, floor: None }
    }
}

impl Settings {
    fn check(&self) -> Result<(), RenderError> {
        for (what, got) in ["width", "height"].into_iter().zip(self.size) {
            if !(1..=MAX_PIXELS).contains(&got) {
                return Err(RenderError::Size { what, got, most: MAX_PIXELS });
            }
        }
        let within = |what, value: f64, minimum: f64, most: f64, rule| {
            let accepted = (minimum..=most).contains(&value);
            if accepted { Ok(()) } else { Err(RenderError::Setting { what, value, rule }) }
        };
        within("azimuth", self.azimuth.unwrap_or(AZIMUTH), -100.0, 100.0, "-100 to 100 rad")?;
        within("elevation", self.elevation, -1.5, 1.5, "-1.5 to 1.5 rad")?;
        within("distance", self.distance.unwrap_or(1.0), 1e-3, 1e4, "0.001 to 10000 m")?;
        within("floor", self.floor.unwrap_or(0.0), -1e4, 1e4, "-10000 to 10000 m")
    }
}

/// State shown in a picture.
#[derive(Debug, Clone, Copy)]
pub struct RenderState<'a> {
    /// Vehicle origin in the world, m.
    pub position: Vector3<f64>,
    /// Body to world rotation.
    pub rotation: Matrix3<f64>,
    /// Coordinates of joints, then of fixtures, rad or m.
    pub q: &'a [f64],
    /// Thrusts, N; none or one per thruster.
    pub thrust: &'a [f64],
    /// Target pose of the vehicle.
    pub target: Option<(Vector3<f64>, Matrix3<f64>)>,
    /// Reference path of the end effector in the world, m.
    pub path: &'a [Vector3<f64>],
    /// Present reference pose of the end effector.
    pub point: Option<(Vector3<f64>, Matrix3<f64>)>,
    /// Pose of the vehicle in the dock, which is a garage where the scene has no shapes of a dock.
    pub dock: Option<(Vector3<f64>, Matrix3<f64>)>,
    /// Past positions of the end effector in the world, m.
    pub trail: &'a [Vector3<f64>],
    /// Velocity of the water in the world, m/s.
    pub current: Vector3<f64>,
    /// Payload at the end effector in addition to the scene's, kg.
    pub payload: f64,
    /// Time of the animation of caustics and flow, s.
    pub time: f64,
}

impl Default for RenderState<'_> {
    fn default() -> Self {
        Self {
            position: Vector3::zeros(),
            rotation: Matrix3::identity(),
            q: &[],
            thrust: &[],
            target: None,
            path: &[],
            point: None,
            dock: None,
            trail: &[],
            current: Vector3::zeros(),
            payload: 0.0,
            time: 0.0,
        }
    }
}

/// Renderer of a scene.
#[derive(Debug)]
pub struct Renderer {
    pub(super) settings: Settings,
    pub(super) azimuth: f64,
    sun: Vector,
    wet: bool,
    hull: Mesh,
    dock: Mesh,
    pub(super) envelope: Envelope,
    pub(super) surroundings: Surroundings,
    thrusters: Vec<Thruster>,
    spheres: Spheres,
    arm: Option<ArmModel>,
    home: Vec<f64>,
    /// Centre and radius of vehicle and arm at home, in the vehicle frame.
    pub(super) middle: Vector,
    pub(super) reach: f32,
    /// Distance of the dock's vertices from the centre of the vehicle's body, m, at most.
    pub(super) dock_reach: f64,
    pub(super) distance: f64,
    floor: f64,
    cell: f64,
    caustics: Caustics,
    /// Pool of scratch buffers.
    scratch: Mutex<Vec<Scratch>>,
}

#[derive(Debug, Default)]
struct Scratch {
    canvas: Canvas,
    corners: Vec<Corner>,
}

impl Renderer {
    /// Renderer of a checked scene. Bodies whose mesh files are all among `facets` are drawn by these.
    ///
    /// # Errors
    /// `RenderError` names the setting that is out of range.
    pub fn new(scene: &Scene, settings: &Settings, facets: &Facets) -> Result<Self, RenderError> {
        settings.check()?;
        let (envelope, hull, thrusters) = hull(scene, facets);
        let arm = ArmModel::new(scene, facets);
        let home: Vec<f64> = scene.coordinates().map(|joint| joint.home).collect();
        let mut combined = hull.clone();
        if let Some(arm) = &arm {
            arm.draw(&mut combined, &home, 0.0);
        }
        let mut bounds = [envelope.middle - envelope.half, envelope.middle + envelope.half];
        if let Some([lower, upper]) = combined.bounds() {
            bounds = [bounds[0].inf(&lower), bounds[1].sup(&upper)];
        }
        let middle = (bounds[0] + bounds[1]) * 0.5;
        let reach = ((bounds[1] - bounds[0]).norm() * 0.5).clamp(1e-3, 1e4);
        let distance = settings.distance.unwrap_or_else(|| 1.12 * Camera::distance_of(f64::from(reach)));
        let mut garage = Mesh::default();
        dock(&mut garage, &envelope);
        let cell = nice(0.6 * f64::from(reach));
        let surroundings = Surroundings::new(scene, cell);
        let at = middle.map(f64::from);
        let near = surroundings.near(&at, f64::from(reach));
        let azimuth = settings.azimuth.unwrap_or_else(|| open_side(near.iter().map(|(shape, _)| shape - at).sum()));
        let lowest = near.iter().map(|(shape, radius)| (shape.z - radius) as f32).fold(bounds[0].z, f32::min);
        let away = |vertex: &Vertex| (vertex.position - envelope.middle).norm();
        let dock_reach = f64::from(garage.vertices.iter().map(away).fold(0.0, f32::max));
        if has_dock(scene) {
            garage = Mesh::default();
        }
        Ok(Self {
            settings: *settings,
            azimuth,
            sun: Camera::new(azimuth + SUN.0, SUN.1, 1.0, [1, 1]).eye,
            wet: scene.water.density > 0.0,
            floor: settings.floor.or(surroundings.seabed).unwrap_or(f64::from(lowest - 0.45 * reach)),
            cell,
            hull,
            dock: garage,
            envelope,
            surroundings,
            thrusters,
            spheres: Spheres::new(scene),
            arm,
            home,
            middle,
            reach,
            dock_reach,
            distance,
            caustics: Caustics::new(),
            scratch: Mutex::new(Vec::new()),
        })
    }

    /// Width and height, pixels.
    pub fn size(&self) -> [usize; 2] {
        self.settings.size
    }

    /// Number of coordinates of the scene: joints, then fixtures.
    pub fn joints(&self) -> usize {
        self.home.len()
    }

    /// Number of thrusters of the scene.
    pub fn thrusters(&self) -> usize {
        self.thrusters.len()
    }

    /// Distance of the camera without a dock and with the reference within the scene's size, m.
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// Azimuth of the camera, rad.
    pub fn azimuth(&self) -> f64 {
        self.azimuth
    }

    /// Height of the floor, m.
    pub fn floor(&self) -> f64 {
        self.floor
    }

    /// Cell width of the floor, m.
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// Draws the picture: red, green, blue by rows from the top.
    pub fn draw(&self, state: &RenderState<'_>) -> Vec<u8> {
        let (camera, focus, zoom) = self.view(state);
        let water = Water::new(self.wet, (self.distance * zoom) as f32, self.sun);
        let (solid, clear) = self.meshes(state, &focus, zoom);
        let mut scratch = self.scratch.lock().ok().and_then(|mut pool| pool.pop()).unwrap_or_default();
        let Scratch { canvas, corners } = &mut scratch;
        canvas.clear(self.settings.size);
        let height = (self.floor - focus.z) as f32;
        let middle = single(&(state.position - focus));
        let middle = if middle.iter().all(|x| x.abs() < FAR as f32) { middle } else { Vector::zeros() };
        let shadow = Shadow::new(&solid, height, &self.sun, &middle, 2.2 * self.reach * zoom as f32);
        let origin = [0, 1].map(|k| (-focus[k]).rem_euclid(20.0 * self.cell) as f32);
        let drift = (0.03 * state.time).rem_euclid(10.0) as f32;
        let floor = Floor {
            height,
            solid: self.settings.floor.is_none() && self.surroundings.seabed.is_some(),
            origin,
            cell: self.cell as f32,
            shadow: &shadow,
            caustics: &self.caustics,
            drift: if drift.is_finite() { drift } else { 0.0 },
        };
        backdrop::paint(canvas, self.settings.size, &camera, &water, &floor);

        shade(&camera, &water, &solid, corners);
        for triangle in &solid.triangles {
            canvas.triangle(&camera, triangle.map(|k| &corners[k as usize]));
        }
        shade(&camera, &water, &clear, corners);
        let depth = |t: &[u32; 3]| -t.iter().map(|k| corners[*k as usize].view.z).sum::<f32>();
        let mut order: Vec<(f32, &[u32; 3])> = clear.triangles.iter().map(|t| (depth(t), t)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, triangle) in order {
            canvas.triangle(&camera, triangle.map(|k| &corners[k as usize]));
        }
        let picture = canvas.resolve();
        if let Ok(mut pool) = self.scratch.lock() {
            pool.push(scratch);
        }
        picture
    }

    /// Opaque and transparent meshes, relative to the focus.
    fn meshes(&self, state: &RenderState<'_>, focus: &Vector3<f64>, zoom: f64) -> (Mesh, Mesh) {
        let (mut solid, mut clear) = (Mesh::default(), Mesh::default());
        let thin = 0.006 * self.reach;
        let q = if state.q.len() == self.home.len() { state.q } else { &self.home };
        let q = Some(q).filter(|q| q.iter().all(|q| q.abs() < FAR));
        self.surroundings.draw_fixed(&mut solid, focus);
        let mut coordinates: Joints = [0.0; JOINTS];
        if let Some(q) = q {
            coordinates.iter_mut().zip(q).for_each(|(coordinate, q)| *coordinate = *q);
            for (mesh, (p, r)) in self.surroundings.fixtures().zip(self.surroundings.poses(&coordinates)) {
                about(focus, &p, &r).into_iter().for_each(|place| solid.append(mesh, place));
            }
        }
        if let Some(place) = about(focus, &state.position, &state.rotation) {
            solid.append(&self.hull, &place);
            if let (Some(arm), Some(q)) = (&self.arm, q) {
                solid.add(&place, |mesh| drop(arm.draw(mesh, q, state.payload)));
            }
            if q.is_some() {
                clear.add(&place, |mesh| self.spheres.draw(mesh, &coordinates));
            }
            clear.add(place, |jets| {
                for (thruster, thrust) in self.thrusters.iter().zip(state.thrust) {
                    marks::jet(jets, thruster, *thrust);
                }
            });
        }
        if let Some(place) = state.target.and_then(|(p, r)| about(focus, &p, &r)) {
            solid.add(place, |mesh| marks::target(mesh, &self.envelope));
        }
        if let Some(place) = state.point.and_then(|(p, r)| about(focus, &p, &r)) {
            solid.add(place, |mesh| {
                marks::axes(mesh, 0.22 * self.reach);
                marks::point(mesh, 3.0 * thin);
            });
        }
        if let Some(place) = state.dock.and_then(|(p, r)| about(focus, &p, &r)) {
            solid.append(&self.dock, place);
        }
        for (points, trail) in [(state.path, false), (state.trail, true)] {
            let points: Vec<Vector> = points.iter().map(|p| single(&(p - focus))).collect();
            marks::line(&mut solid, &points, thin, trail);
        }
        if self.wet && state.current.iter().all(|x| x.abs() < FAR) && state.time.abs() < 1e12 {
            let origin = single(&(-focus));
            let floor = (self.floor - focus.z) as f32;
            // In steps, so that particles keep their places while the camera moves away.
            let wide = if zoom > 1.0 { zoom.log2().ceil().exp2() as f32 } else { 1.0 };
            marks::flow(&mut clear, &single(&state.current), state.time, &origin, 1.9 * self.reach * wide, floor);
        }
        (solid, clear)
    }
}

/// Shades the vertices of a mesh and transforms them to camera coordinates.
fn shade(camera: &Camera, water: &Water, mesh: &Mesh, corners: &mut Vec<Corner>) {
    corners.clear();
    corners.extend(mesh.vertices.iter().map(|vertex| {
        let Vertex { position, normal, paint } = vertex;
        let to_eye = camera.eye - position;
        let way = to_eye.norm();
        let to_eye = to_eye / way.max(1e-6);
        let [r, g, b] = water.shade(paint, normal, &to_eye, way).map(display);
        Corner { view: camera.view(position), colour: [r, g, b, paint.alpha] }
    }));
}

/// Transform of vertices from a frame to coordinates about the focus; None if it is not finite.
fn about(
    focus: &Vector3<f64>,
    position: &Vector3<f64>,
    rotation: &Matrix3<f64>,
) -> Option<impl Fn(&Vertex) -> Vertex + use<>> {
    let finite = position.iter().chain(rotation.iter()).all(|x| x.abs() < FAR);
    finite.then(|| placed(&(position - focus, *rotation)))
}

/// Azimuth of the camera on the side without the shapes, which are in this direction from the vehicle.
fn open_side(shapes: Vector3<f64>) -> f64 {
    let hides = shapes.x * AZIMUTH.cos() + shapes.y * AZIMUTH.sin() > 0.0;
    let mirrored = std::f64::consts::PI + 2.0 * shapes.y.atan2(shapes.x) - AZIMUTH;
    if hides { mirrored } else { AZIMUTH }
}

/// Largest number of the series 1, 2, 5, 10, ... that is at most `x`.
fn nice(x: f64) -> f64 {
    let mut step = 1e-3;
    for factor in [2.0, 2.5, 2.0].into_iter().cycle() {
        if step * factor > x || step > 1e6 {
            break;
        }
        step *= factor;
    }
    step
}

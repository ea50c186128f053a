//! Renderer: pictures of states.

use std::sync::Mutex;

use nalgebra::{Matrix3, Vector3};

use super::Vector;
use super::arm::ArmModel;
use super::backdrop::{self, Caustics, Floor};
use super::camera::Camera;
use super::dock::dock;
use super::files::Facets;
use super::hull::{Envelope, Thruster, hull, single};
use super::marks;
use super::mesh::{Mesh, Vertex};
use super::paint::{Water, display};
use super::raster::{Canvas, Corner};
use super::shadow::Shadow;
use crate::description::Scene;
use crate::error::RenderError;

/// Maximum width and height, pixels.
const MAX_PIXELS: usize = 4096;
/// Maximum magnitude of drawn coordinates, m.
const FAR: f64 = 1e5;
/// Maximum ratio of the radius of what the picture shows to the scene's radius.
const WIDEST: f64 = 24.0;
/// Azimuth relative to the camera and elevation of the sun, rad: to the left and high.
const SUN: (f64, f64) = (-0.75, 1.05);

/// Settings of a renderer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Azimuth of the camera relative to its focus, about the vertical from x, rad.
    pub azimuth: f64,
    /// Elevation of the camera above the horizontal, rad.
    pub elevation: f64,
    /// Distance of the camera, m; None: by the size of what the picture shows.
    pub distance: Option<f64>,
    /// Height of the floor, m; None: below the scene at the origin.
    pub floor: Option<f64>,
}

impl Default for Settings {
    fn default() -> Self {
        Self { size: [640, 480], azimuth: -0.95, elevation: 0.32, distance: None, floor: None }
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
        within("azimuth", self.azimuth, -100.0, 100.0, "-100 to 100 rad")?;
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
    /// Joint coordinates, rad or m.
    pub q: &'a [f64],
    /// Thrusts, N; none or one per thruster.
    pub thrust: &'a [f64],
    /// Target pose of the vehicle.
    pub target: Option<(Vector3<f64>, Matrix3<f64>)>,
    /// Reference path of the end effector in the world, m.
    pub path: &'a [Vector3<f64>],
    /// Present reference pose of the end effector.
    pub point: Option<(Vector3<f64>, Matrix3<f64>)>,
    /// Pose of the vehicle in the dock.
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
    settings: Settings,
    sun: Vector,
    wet: bool,
    hull: Mesh,
    dock: Mesh,
    envelope: Envelope,
    thrusters: Vec<Thruster>,
    arm: Option<ArmModel>,
    home: Vec<f64>,
    /// Centre and radius of vehicle and arm at home, in the vehicle frame.
    middle: Vector,
    reach: f32,
    /// Distance of the dock's vertices from the centre of the vehicle's body, m, at most.
    dock_reach: f64,
    distance: f64,
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
        let home: Vec<f64> = scene.joints().map(|joint| joint.home).collect();
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
        let away = |vertex: &Vertex| (vertex.position - envelope.middle).norm();
        let dock_reach = f64::from(garage.vertices.iter().map(away).fold(0.0, f32::max));
        Ok(Self {
            settings: *settings,
            sun: Camera::new(settings.azimuth + SUN.0, SUN.1, 1.0, [1, 1]).eye,
            wet: scene.water.density > 0.0,
            floor: settings.floor.unwrap_or(f64::from(bounds[0].z - 0.45 * reach)),
            cell: nice(0.6 * f64::from(reach)),
            hull,
            dock: garage,
            envelope,
            thrusters,
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

    /// Number of joints of the scene.
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

    /// Height of the floor, m.
    pub fn floor(&self) -> f64 {
        self.floor
    }

    /// Cell width of the floor, m.
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// Focus of the camera: the target if there is one, else the vehicle; limited to a distance that keeps the vehicle in the
    /// picture.
    fn focus(&self, state: &RenderState<'_>) -> Vector3<f64> {
        let place = |(p, r): (Vector3<f64>, Matrix3<f64>)| {
            let at = p + r * self.middle.map(f64::from);
            (at.iter().all(|x| x.abs() < FAR)).then_some(at)
        };
        let vehicle = place((state.position, state.rotation));
        match (state.target.and_then(place), vehicle) {
            (Some(target), Some(vehicle)) => {
                let (distance, most) = ((vehicle - target).norm(), 0.5 * f64::from(self.reach));
                if distance > most { vehicle + (target - vehicle) * (most / distance) } else { target }
            }
            (Some(at), None) | (None, Some(at)) => at,
            (None, None) => Vector3::zeros(),
        }
    }

    /// Camera, its focus, and the ratio of the radius of what it shows to the radius of the scene: vehicle, end effector's reference and dock.
    fn view(&self, state: &RenderState<'_>) -> (Camera, Vector3<f64>, f64) {
        let reach = f64::from(self.reach);
        let (mut focus, mut radius) = (self.focus(state), reach);
        let mut include = |at: Vector3<f64>, own: f64| {
            let distance = (at - focus).norm();
            // Of two balls, the smallest one about both.
            let both = (0.5 * (radius + own + distance)).max(own).min(WIDEST * reach);
            if self.settings.distance.is_none() && both > radius {
                focus += (at - focus) * ((both - radius) / distance.max(1e-9)).min(1.0);
                radius = both;
            }
        };
        if let Some((at, _)) = state.point.filter(|(p, _)| p.iter().all(|x| x.abs() < FAR)) {
            include(at, 0.2 * reach);
        }
        if let Some((p, r)) = state.dock.filter(|(p, r)| p.iter().chain(r.iter()).all(|x| x.abs() < FAR)) {
            include(p + r * self.envelope.middle.map(f64::from), self.dock_reach);
        }
        let zoom = radius / reach;
        let Settings { azimuth, elevation, size, .. } = self.settings;
        (Camera::new(azimuth, elevation, self.distance * zoom, size), focus, zoom)
    }

    /// Pixel (along, down) and depth, m, of a point of the world in the picture of `state`; None behind the camera.
    pub fn project(&self, state: &RenderState<'_>, point: &Vector3<f64>) -> Option<[f64; 3]> {
        let (camera, focus, _) = self.view(state);
        let view = camera.view(&single(&(point - focus)));
        let [x, y] = camera.project(&view);
        (view.z >= camera.near).then(|| [x, y, view.z].map(f64::from))
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
        if let Some(place) = placed(&state.position, &state.rotation, focus) {
            solid.append(&self.hull, &place);
            if let Some(arm) = &self.arm {
                let q = if state.q.len() == self.home.len() { state.q } else { &self.home };
                if q.iter().all(|q| q.abs() < FAR) {
                    solid.add(&place, |mesh| drop(arm.draw(mesh, q, state.payload)));
                }
            }
            clear.add(place, |jets| {
                for (thruster, thrust) in self.thrusters.iter().zip(state.thrust) {
                    marks::jet(jets, thruster, *thrust);
                }
            });
        }
        if let Some(place) = state.target.and_then(|(p, r)| placed(&p, &r, focus)) {
            solid.add(place, |mesh| marks::target(mesh, &self.envelope));
        }
        if let Some(place) = state.point.and_then(|(p, r)| placed(&p, &r, focus)) {
            solid.add(place, |mesh| {
                marks::axes(mesh, 0.22 * self.reach);
                marks::point(mesh, 3.0 * thin);
            });
        }
        if let Some(place) = state.dock.and_then(|(p, r)| placed(&p, &r, focus)) {
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
fn placed(
    position: &Vector3<f64>,
    rotation: &Matrix3<f64>,
    focus: &Vector3<f64>,
) -> Option<impl Fn(&Vertex) -> Vertex + use<>> {
    let finite = position.iter().chain(rotation.iter()).all(|x| x.abs() < FAR);
    let (r, p) = (rotation.map(|x| x as f32), single(&(position - focus)));
    finite.then_some(move |v: &Vertex| Vertex { position: r * v.position + p, normal: r * v.normal, paint: v.paint })
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

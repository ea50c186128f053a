//! Shapes of contact: planes, boxes, cylinders and tori in the world and on fixtures.

use nalgebra::{Matrix3, Vector3};

use super::Vector;
use super::hull::single;
use super::mesh::{Mesh, Vertex};
use super::paint::Paint;
use crate::description::{ContactGeometry, Scene};
use crate::system::{EndEffector, Joints};

const WORLD: Paint = Paint::new(0x8795A0).glossy(0.15);
const FIXTURE: Paint = Paint::new(0xD8452F).glossy(0.3);
/// Mark that shows the turn of a body of revolution on a fixture.
const MARK: Paint = Paint::new(0xF6F4EA).glossy(0.3);
const TILES: [Paint; 2] = [Paint::new(0xA9A288), Paint::new(0x99937D)];
/// Segments of cylinders and tori.
const SEGMENTS: usize = 48;
/// Tiles from the middle of a drawn plane to its edge.
const TILES_ASIDE: i32 = 16;

/// Position and rotation to the world.
type Place = (Vector3<f64>, Matrix3<f64>);

/// Shapes of a scene.
#[derive(Debug)]
pub struct Surroundings {
    /// Bounded shapes in the world.
    fixed: Mesh,
    /// Kinematics of each fixture, and its shapes in its frame.
    fixtures: Vec<(EndEffector, Mesh)>,
    /// Planes in the world that are not level.
    planes: Vec<Place>,
    /// Height of the highest level plane above a solid, m.
    pub seabed: Option<f64>,
    /// Box about each bounded shape, fixtures at home: its middle, and half its edges, m.
    boxes: Vec<(Place, Vector3<f64>)>,
    cell: f64,
}

impl Surroundings {
    /// Shapes of a checked scene; planes are drawn as tiles of this width, m.
    pub fn new(scene: &Scene, cell: f64) -> Self {
        let fixtures = EndEffector::fixtures(scene).into_iter().map(|frame| (frame, Mesh::default())).collect();
        let (planes, boxes) = (Vec::new(), Vec::new());
        let mut this = Self { fixed: Mesh::default(), fixtures, planes, seabed: None, boxes, cell };
        for shape in scene.contact.iter().flat_map(|contact| &contact.shapes) {
            let (position, rotation) = (shape.frame.position, shape.frame.rotation());
            let fixture = scene.fixtures.iter().position(|fixture| fixture.name == shape.on);
            let half = match shape.geometry {
                ContactGeometry::Plane if fixture.is_none() && rotation[(2, 2)] > 1.0 - 1e-12 => {
                    this.seabed = Some(this.seabed.map_or(position.z, |height| height.max(position.z)));
                    continue;
                }
                ContactGeometry::Plane if fixture.is_none() => {
                    this.planes.push((position, rotation));
                    continue;
                }
                ContactGeometry::Plane => Vector3::new(cell, cell, 0.0),
                ContactGeometry::Box { size } => size * 0.5,
                ContactGeometry::Cylinder { radius, length } => Vector3::new(radius, radius, 0.5 * length),
                ContactGeometry::Torus { radius, tube } => Vector3::new(radius + tube, radius + tube, tube),
            };
            let (to_world, mesh) = match fixture {
                Some(k) => (Some(this.fixtures[k].0.pose(&scene.home())), &mut this.fixtures[k].1),
                None => (None, &mut this.fixed),
            };
            let paints = match (shape.colour, fixture) {
                (Some(colour), _) => [Paint { colour: colour.map(|c| (c * c) as f32), ..WORLD }; 2],
                (None, Some(_)) => [FIXTURE, MARK],
                (None, None) => [WORLD; 2],
            };
            mesh.add(placed(&(position, rotation)), |mesh| solid(mesh, &shape.geometry, cell as f32, paints));
            let (r, p) = to_world.unwrap_or((Matrix3::identity(), Vector3::zeros()));
            this.boxes.push(((r * position + p, r * rotation), half));
        }
        this
    }

    /// Shapes on each fixture, in its frame.
    pub fn fixtures(&self) -> impl Iterator<Item = &Mesh> {
        self.fixtures.iter().map(|(_, mesh)| mesh)
    }

    /// Poses of the fixtures at coordinates `q`.
    pub fn poses(&self, q: &Joints) -> Vec<Place> {
        self.fixtures.iter().map(|(frame, _)| frame.pose(q)).map(|(rotation, position)| (position, rotation)).collect()
    }

    /// Adds all shapes in the world but the seabed, relative to the point `about`, around which planes are drawn.
    pub fn draw_fixed(&self, mesh: &mut Mesh, about: &Vector3<f64>) {
        mesh.append(&self.fixed, placed(&(-about, Matrix3::identity())));
        for (position, rotation) in &self.planes {
            // In steps of the pattern, so that tiles keep their places.
            let step = 2.0 * self.cell;
            let along = (rotation.transpose() * (about - position)).map(|x| step * (x / step).round());
            let middle = position - about + rotation * Vector3::new(along.x, along.y, 0.0);
            mesh.add(placed(&(middle, *rotation)), |mesh| tiles(mesh, self.cell as f32, TILES_ASIDE));
        }
    }

    /// Balls about the bounded shapes within four times `reach` of a point, middle and radius. Long shapes count by the part
    /// next to the point; beyond twice `reach` the balls shrink and approach the point.
    pub fn near(&self, at: &Vector3<f64>, reach: f64) -> Vec<(Vector3<f64>, f64)> {
        let ball = |((position, rotation), half): &(Place, Vector3<f64>)| {
            let part = half.map(|h| h.min(reach));
            let rest = half - part;
            let middle = (rotation.transpose() * (at - position)).zip_map(&rest, |x, rest| x.clamp(-rest, rest));
            let (away, radius) = (position + rotation * middle - at, part.norm());
            let share = (2.0 - (away.norm() - radius) / (2.0 * reach)).min(1.0);
            (share > 0.0).then(|| (at + away * share, radius * share))
        };
        self.boxes.iter().filter_map(ball).collect()
    }
}

/// Adds a shape in its frame, large ones in parts of some cells, because light is interpolated between vertices: the paint of its
/// surface, and of the mark of a body of revolution, in the direction of x.
pub fn solid(mesh: &mut Mesh, geometry: &ContactGeometry, cell: f32, [surface, mark]: [Paint; 2]) {
    let first = mesh.vertices.len();
    let parts = |length: f32| (length / (4.0 * cell)).ceil().clamp(1.0, 24.0) as i32;
    match *geometry {
        ContactGeometry::Plane => return tiles(mesh, cell, 1),
        ContactGeometry::Box { size } => {
            let half = single(&(size * 0.5));
            for k in 0..3 {
                let [normal, u, v] = [k, (k + 1) % 3, (k + 2) % 3].map(|k| Vector::ith(k, half[k]));
                let counts = [(k + 1) % 3, (k + 2) % 3].map(|k| parts(2.0 * half[k]));
                for (normal, u) in [(normal, u), (-normal, -u)] {
                    grid(mesh, normal - u - v, [u * 2.0, v * 2.0], counts, |_| surface);
                }
            }
            return;
        }
        ContactGeometry::Cylinder { radius, length } => {
            let (radius, length) = (radius as f32, length as f32);
            let count = parts(length);
            let side = (0..=count).map(|k| (k as f32 / count as f32 * length, radius));
            let profile: Vec<_> = [(0.0, 0.0)].into_iter().chain(side).chain([(length, 0.0)]).collect();
            mesh.lathe(Vector::z() * (-0.5 * length), Vector::z(), &profile, SEGMENTS, false, |_| surface);
        }
        ContactGeometry::Torus { radius, tube } => mesh.torus(radius as f32, tube as f32, SEGMENTS, surface),
    }
    // Rings of vertices begin at x.
    let marked = |k: &usize| (k + SEGMENTS / 24) % SEGMENTS <= SEGMENTS / 12;
    for (_, vertex) in mesh.vertices[first..].iter_mut().enumerate().filter(|(k, _)| marked(k)) {
        vertex.paint = mark;
    }
}

/// Tiles of the plane z = 0, seen from above.
fn tiles(mesh: &mut Mesh, cell: f32, aside: i32) {
    let half = aside as f32 * cell;
    let edges = [Vector::x(), Vector::y()].map(|axis| axis * (2.0 * half));
    grid(mesh, Vector::new(-half, -half, 0.0), edges, [2 * aside; 2], |k| TILES[(k & 1) as usize]);
}

/// A parallelogram from a corner along two edges, in equal parts; the paint depends on the sum of their two numbers.
fn grid(mesh: &mut Mesh, corner: Vector, [u, v]: [Vector; 2], [n, m]: [i32; 2], paint: impl Fn(i32) -> Paint) {
    let at = |i: i32, k: i32| corner + u * (i as f32 / n as f32) + v * (k as f32 / m as f32);
    for (i, k) in (0..n).flat_map(|i| (0..m).map(move |k| (i, k))) {
        mesh.polygon(&[at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)], paint(i + k));
    }
}

/// Transform of vertices by a pose.
pub fn placed((position, rotation): &Place) -> impl Fn(&Vertex) -> Vertex + use<> {
    let (r, p) = (rotation.map(|x| x as f32), single(position));
    move |v: &Vertex| Vertex { position: r * v.position + p, normal: r * v.normal, paint: v.paint }
}

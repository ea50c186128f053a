//! Geometry of the vehicle's body and thrusters.

use super::Vector;
use super::files::{Facets, drawn};
use super::mesh::{Mesh, across};
use super::paint::Paint;
use crate::description::{Scene, ShapeKind};

const DARK: Paint = Paint::new(0x2A3038).glossy(0.15);
const METAL: Paint = Paint::new(0xB4BCC4).glossy(0.35);
const WHITE: Paint = Paint::new(0xECEEEA).glossy(0.25);
const GLASS: Paint = Paint::new(0x6FA9C4).glossy(0.9);
const LAMP: Paint = Paint::new(0xFFF6D8).glowing(0.9);
const DUCT: Paint = Paint::new(0x23282F).glossy(0.2);
const BLADE: Paint = Paint::new(0x8A949E).glossy(0.2);
const NOSE: Paint = Paint::new(0xE8512A);

/// Bounding box of the body in the vehicle frame.
#[derive(Debug, Clone, Copy)]
pub struct Envelope {
    /// Centre, m.
    pub middle: Vector,
    /// Half edges, m.
    pub half: Vector,
}

/// Duct of a thruster.
#[derive(Debug, Clone, Copy)]
pub struct Thruster {
    /// Position, m.
    pub position: Vector,
    /// Direction of positive thrust.
    pub axis: Vector,
    /// Minimum and maximum thrust, N.
    pub limits: [f64; 2],
    /// Radius of the duct, m.
    pub radius: f32,
}

/// Bounding box, mesh and thrusters of a scene's vehicle, in its frame; mesh files take the place of shape and thrusters.
pub fn hull(scene: &Scene, facets: &Facets) -> (Envelope, Mesh, Vec<Thruster>) {
    let vehicle = &scene.vehicle;
    let shape = vehicle.outline(&scene.water);
    let half = single(&(shape.size * 0.5)).map(|h| h.clamp(1e-3, 1e3));
    let mut envelope = Envelope { middle: single(&shape.position), half };
    let colour = shape.colour.map(|c| (c * c) as f32);
    let coat = Paint { colour, ..Paint::new(0) }.glossy(0.2);
    let drawn = drawn(&vehicle.meshes, facets, coat);
    let mut mesh = Mesh::default();
    match shape.kind {
        _ if drawn.is_some() => {}
        ShapeKind::Box => solid(&mut mesh, &envelope, coat),
        ShapeKind::Ellipsoid => {
            mesh.ellipsoid(envelope.middle, half, 28, |share| if share > 0.88 { NOSE } else { coat });
        }
        ShapeKind::Torpedo => torpedo(&mut mesh, &envelope, coat),
        ShapeKind::Frame => frame(&mut mesh, &envelope, coat),
        ShapeKind::Lattice => lattice(&mut mesh, &envelope, coat),
    }
    let radius = 0.11 * (8.0 * half.x * half.y * half.z).cbrt();
    let thrusters: Vec<Thruster> = vehicle
        .thrusters
        .iter()
        .map(|t| Thruster { position: single(&t.position), axis: single(&t.axis), limits: t.limits, radius })
        .collect();
    if let Some((drawn, [lower, upper])) = drawn.and_then(|drawn| drawn.bounds().map(|bounds| (drawn, bounds))) {
        mesh = drawn;
        let half = ((upper - lower) * 0.5).map(|h| h.clamp(1e-3, 1e3));
        envelope = Envelope { middle: (lower + upper) * 0.5, half };
    } else {
        thrusters.iter().for_each(|thruster| duct(&mut mesh, thruster));
    }
    (envelope, mesh, thrusters)
}

/// The vector in single precision.
pub fn single(v: &nalgebra::Vector3<f64>) -> Vector {
    v.map(|x| x as f32)
}

/// A box with a marked front.
fn solid(mesh: &mut Mesh, envelope: &Envelope, coat: Paint) {
    let Envelope { middle, half } = *envelope;
    let cut = 0.16 * half.min();
    mesh.chamfered(middle, half, cut, coat);
    let front = Vector::new(half.x, 0.0, 0.0);
    let window = Vector::new(0.015 * half.x, 0.55 * half.y, 0.4 * half.z);
    mesh.cuboid(middle + front, window, DARK);
    for side in [-1.0, 1.0] {
        let lamp = middle + front + Vector::new(0.0, side * 0.36 * half.y, 0.0);
        let r = 0.1 * half.y.min(half.z);
        mesh.cylinder(lamp, lamp + Vector::x() * (0.05 * half.x), r, 14, LAMP);
    }
    // A stripe from front to rear over the top.
    let stripe = Vector::new(0.7 * half.x, 0.12 * half.y, 0.012 * half.z);
    mesh.cuboid(middle + Vector::z() * half.z, stripe, NOSE);
}

/// A body of revolution along x with four fins.
fn torpedo(mesh: &mut Mesh, envelope: &Envelope, coat: Paint) {
    let Envelope { middle, half } = *envelope;
    let (length, radius) = (2.0 * half.x, half.y.min(half.z));
    let mut profile = vec![(0.0, 0.0), (0.0, 0.18 * radius)];
    let steps = 8;
    for k in 1..=steps {
        let share = k as f32 / steps as f32;
        profile.push((0.28 * length * share, radius * (0.18 + 0.82 * share * (2.0 - share))));
    }
    let nose = (0.45 * length).min(1.6 * radius);
    for k in 0..=steps {
        let share = k as f32 / steps as f32;
        profile.push((length - nose * (1.0 - share), radius * (1.0 - share * share).max(0.0).sqrt()));
    }
    let count = profile.len();
    let rear = middle - Vector::x() * half.x;
    let paint = |i: usize| if i + 4 > count { NOSE } else { coat };
    mesh.lathe(rear, Vector::x(), &profile, 28, true, paint);
    for out in [Vector::y(), Vector::z(), -Vector::y(), -Vector::z()] {
        let span = out * (0.62 * radius);
        let chord = Vector::x() * (0.07 * length);
        let thickness = chord.cross(&out).normalize() * (0.03 * radius);
        let at = rear + Vector::x() * (0.09 * length) + out * (0.95 * radius);
        mesh.slab(at, [span, thickness, chord], DARK);
    }
}

/// An open frame: floats on top, side plates with holes, pressure hulls between them.
fn frame(mesh: &mut Mesh, envelope: &Envelope, coat: Paint) {
    let Envelope { middle, half } = *envelope;
    let at = |x: f32, y: f32, z: f32| middle + Vector::new(x * half.x, y * half.y, z * half.z);
    let size = |x: f32, y: f32, z: f32| Vector::new(x * half.x, y * half.y, z * half.z);
    let cut = 0.09 * half.z;
    for side in [-1.0, 1.0] {
        mesh.chamfered(at(0.0, 0.31 * side, 0.72), size(0.92, 0.27, 0.28), cut, coat);
        let y = 0.95 * side;
        mesh.cuboid(at(0.0, y, -0.88), size(1.0, 0.05, 0.12), DARK);
        mesh.cuboid(at(0.0, y, 0.46), size(0.96, 0.03, 0.2), DARK);
        mesh.cuboid(at(0.0, y, 0.7), size(0.9, 0.035, 0.05), coat);
        for x in [-0.86, 0.0, 0.86] {
            mesh.cuboid(at(x, y, -0.26), size(0.12, 0.03, 0.54), DARK);
        }
        // Lamps.
        let lamp = at(0.9, 0.6 * side, -0.05);
        let r = 0.1 * half.z;
        mesh.cylinder(lamp, lamp + Vector::x() * (0.1 * half.x), r, 14, METAL);
        let glass = lamp + Vector::x() * (0.1 * half.x);
        mesh.cylinder(glass, glass + Vector::x() * (0.012 * half.x), 0.8 * r, 14, LAMP);
    }
    for x in [-0.9, 0.9] {
        mesh.cuboid(at(x, 0.0, -0.88), size(0.05, 0.95, 0.06), DARK);
        mesh.cuboid(at(x, 0.0, 0.4), size(0.04, 0.95, 0.07), DARK);
    }
    let r = 0.42 * half.z.min(half.y);
    mesh.cylinder(at(-0.7, 0.0, 0.12), at(0.62, 0.0, 0.12), r, 24, WHITE);
    for x in [-0.7, 0.56] {
        mesh.cylinder(at(x, 0.0, 0.12), at(x + 0.08, 0.0, 0.12), 1.1 * r, 24, METAL);
    }
    mesh.ellipsoid(at(0.64, 0.0, 0.12), Vector::new(r, r, r) * 0.98, 18, |_| GLASS);
    let r = 0.7 * r;
    mesh.cylinder(at(-0.6, 0.0, -0.62), at(0.55, 0.0, -0.62), r, 20, METAL);
    mesh.cylinder(at(0.5, 0.0, -0.62), at(0.62, 0.0, -0.62), 1.08 * r, 20, DARK);
}

/// A perforated box about a pressure hull.
fn lattice(mesh: &mut Mesh, envelope: &Envelope, coat: Paint) {
    let Envelope { middle, half } = *envelope;
    let beam = 0.055 * half.max();
    let axes = [Vector::x() * half.x, Vector::y() * half.y, Vector::z() * half.z];
    for k in 0..3 {
        let [along, u, v] = [axes[k], axes[(k + 1) % 3], axes[(k + 2) % 3]];
        let inset = 1.0 - beam / half.max();
        for (a, b) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            let at = middle + (u * a + v * b) * inset;
            mesh.slab(at, [along, u.normalize() * beam, v.normalize() * beam], coat);
        }
        // Bars of the two faces across this axis; the top is closed more than the others.
        for side in [-1.0, 1.0] {
            let face = middle + along * side * inset;
            let wide = if k == 2 { 1.3 } else { 0.75 } * beam;
            let thin = along.normalize() * (0.35 * beam);
            for (run, over) in [(u, v), (v, u)] {
                for step in [-0.5, 0.0, 0.5] {
                    // Right-handed in either order.
                    let sign = if run == u { 1.0 } else { -1.0 };
                    let cross = over.normalize() * (wide * sign);
                    mesh.slab(face + over * step, [run * inset, cross, thin], coat.mix(WHITE, 0.12));
                }
            }
        }
    }
    let r = 0.34 * half.y.min(half.z);
    mesh.capsule(middle - axes[0] * 0.5, middle + axes[0] * 0.5, r, 24, WHITE);
    for x in [-0.35, 0.35] {
        mesh.cylinder(middle + axes[0] * (x - 0.05), middle + axes[0] * (x + 0.05), 1.06 * r, 24, METAL);
    }
    // Mark of the front.
    let badge = Vector::new(0.6 * beam, 0.28 * half.y, 0.16 * half.z);
    mesh.chamfered(middle + axes[0], badge, 0.2 * beam, DARK);
    for side in [-1.0, 1.0] {
        let lamp = middle + axes[0] + Vector::new(0.5 * beam, side * 0.17 * half.y, 0.0);
        mesh.cylinder(lamp, lamp + Vector::x() * (0.5 * beam), 0.07 * half.z, 14, LAMP);
    }
}

/// A ducted propeller.
fn duct(mesh: &mut Mesh, thruster: &Thruster) {
    let Thruster { position, axis, radius: r, .. } = *thruster;
    let (l, inner) = (0.55 * r, 0.84 * r);
    let ring = [(-l, inner), (-0.9 * l, r), (0.9 * l, 1.06 * r), (l, inner * 1.06), (-l, inner)];
    mesh.lathe(position, axis, &ring, 20, false, |i| if i == 2 || i == 3 { NOSE.mix(DUCT, 0.35) } else { DUCT });
    mesh.capsule(position - axis * (0.7 * l), position + axis * (0.5 * l), 0.26 * r, 12, METAL);
    let [e1, e2] = across(&axis);
    for (cos, sin) in [(1.0, 0.0), (-0.5, 0.866), (-0.5, -0.866)] {
        let out = e1 * cos + e2 * sin;
        let aside = axis.cross(&out);
        let blade = [out * (0.29 * r), (aside * 0.17 + axis * 0.13) * r, (axis * 0.17 - aside * 0.13) * (0.15 * r)];
        mesh.slab(position + out * (0.54 * r), blade, BLADE);
    }
}

//! Geometry of a dock.

use super::Vector;
use super::hull::Envelope;
use super::mesh::Mesh;
use super::paint::Paint;
use crate::description::{DOCK, Scene};

const FLOAT: Paint = Paint::new(0xF2B51D).glossy(0.15);
const STEEL: Paint = Paint::new(0xDDE3E6).glossy(0.3);
const BLACK: Paint = Paint::new(0x1E2227).glossy(0.1);
const WHITE: Paint = Paint::new(0xF4F5F2).glossy(0.1);
/// Lights of the entrance, starboard and port.
const LIGHTS: [Paint; 2] = [Paint::new(0x3DFF6E).glowing(1.0), Paint::new(0xFF4136).glowing(1.0)];

/// True for a scene with the shapes of a dock.
pub fn has_dock(scene: &Scene) -> bool {
    scene.contact.iter().flat_map(|contact| &contact.shapes).any(|shape| shape.name.starts_with(DOCK))
}

/// A floating garage about the docked vehicle, in the vehicle's frame: floats at its sides under three gates, a funnel at the
/// entrance (-x), fenders and a board of markers at the end. It is open below, for an arm.
pub fn dock(mesh: &mut Mesh, envelope: &Envelope) {
    let Envelope { middle, half } = *envelope;
    let s = (half.x * half.y * half.z).cbrt();
    let (thin, float) = (0.045 * s, 0.15 * s);
    let (rear, end, wide, top) = (-half.x - 0.3 * s, half.x + 0.35 * s, half.y + 0.3 * s + float, half.z + 0.35 * s);
    let low = -0.5 * half.z;
    let at = |x: f32, y: f32, z: f32| middle + Vector::new(x, y, z);
    for (side, light) in [-1.0, 1.0].into_iter().zip(LIGHTS) {
        let y = side * wide;
        mesh.capsule(at(rear, y, low), at(end, y, low), float, 20, FLOAT);
        for x in [0.6 * rear, 0.0, 0.6 * end] {
            mesh.cylinder(at(x - 0.06 * s, y, low), at(x + 0.06 * s, y, low), 1.06 * float, 20, BLACK);
        }
        mesh.beam(at(rear, y, top), at(end, y, top), thin, STEEL);
        // The funnel.
        let (out, up) = (side * (wide + 0.5 * s), top + 0.4 * s);
        let mouth = rear - 0.7 * s;
        mesh.capsule(at(rear, y, low), at(mouth, out, low), 0.75 * float, 20, FLOAT);
        mesh.beam(at(rear, y, top), at(mouth, out, up), thin, STEEL);
        striped(mesh, at(mouth, out, low), at(mouth, out, up), thin);
        mesh.ellipsoid(at(mouth, out, up + 0.12 * s), Vector::repeat(0.11 * s), 14, |_| light);
    }
    striped(
        mesh,
        at(rear - 0.7 * s, -wide - 0.5 * s, top + 0.4 * s),
        at(rear - 0.7 * s, wide + 0.5 * s, top + 0.4 * s),
        thin,
    );
    for x in [rear, 0.5 * (rear + end), end] {
        for side in [-1.0, 1.0] {
            mesh.beam(at(x, side * wide, low), at(x, side * wide, top), thin, STEEL);
        }
        mesh.beam(at(x, -wide, top), at(x, wide, top), thin, STEEL);
    }
    // The end: a bar with two fenders, and markers.
    mesh.beam(at(end, -wide, 0.1 * half.z), at(end, wide, 0.1 * half.z), thin, STEEL);
    for side in [-0.5, 0.5] {
        let y = side * half.y;
        mesh.capsule(
            at(end - 1.6 * thin, y, -0.25 * half.z),
            at(end - 1.6 * thin, y, 0.45 * half.z),
            0.09 * s,
            14,
            BLACK,
        );
    }
    let (board, high) = (0.3 * s, top + 0.32 * s);
    mesh.cuboid(at(end, 0.0, high), Vector::new(0.02 * s, board, board), WHITE);
    for (row, pattern) in [0b1011_u32, 0b0101, 0b1110, 0b1001].into_iter().enumerate() {
        for column in (0..4).filter(|k| pattern >> k & 1 == 1) {
            let place = |k: usize| (k as f32 - 1.5) * 0.4 * board;
            let tile = Vector::new(0.03 * s, 0.2 * board, 0.2 * board);
            mesh.cuboid(at(end, place(column), high + place(row)), tile, BLACK);
        }
    }
}

/// A bar in yellow and black.
fn striped(mesh: &mut Mesh, from: Vector, to: Vector, half: f32) {
    const PARTS: usize = 9;
    let point = |k: usize| from + (to - from) * (k as f32 / PARTS as f32);
    for k in 0..PARTS {
        mesh.beam(point(k), point(k + 1), 1.2 * half, if k % 2 == 0 { FLOAT } else { BLACK });
    }
}

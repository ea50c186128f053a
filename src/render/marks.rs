//! Annotations: target, reference, thruster jets, flow.

use super::Vector;
use super::hull::{Envelope, Thruster};
use super::mesh::{Mesh, across};
use super::paint::Paint;

const TARGET: Paint = Paint::new(0x8CFFB4).glowing(0.85);
const PATH: Paint = Paint::new(0xFFE36B).glowing(0.8);
const POINT: Paint = Paint::new(0xFFF4B8).glowing(0.9);
const TRAIL: Paint = Paint::new(0xFF5FD8).glowing(0.8);
const FLOW: Paint = Paint::new(0xF2FFFF).glowing(1.0);
const AXES: [Paint; 3] =
    [Paint::new(0xFF4B3E).glowing(0.75), Paint::new(0x5CE05A).glowing(0.75), Paint::new(0x4A8CFF).glowing(0.75)];
const WEAK: Paint = Paint::new(0xBFF6FF).glowing(1.0);
const STRONG: Paint = Paint::new(0xFFC23A).glowing(1.0);
const FULL: Paint = Paint::new(0xFF3B2A).glowing(1.0);

/// Brackets at the corners of the vehicle's bounding box at the target.
pub fn target(mesh: &mut Mesh, envelope: &Envelope) {
    let half = envelope.half + Vector::repeat(0.1 * envelope.half.max());
    let thin = 0.011 * half.norm();
    for bits in 0..8 {
        let corner = Vector::from_fn(|k, _| if bits >> k & 1 == 1 { half[k] } else { -half[k] });
        for k in 0..3 {
            let inward = Vector::ith(k, -corner[k].signum());
            let at = envelope.middle + corner;
            mesh.beam(at - inward * thin, at + inward * (0.36 * half[k]), thin, TARGET);
        }
    }
}

/// Arrows along x (red), y (green), z (blue).
pub fn axes(mesh: &mut Mesh, length: f32) {
    for (k, paint) in AXES.into_iter().enumerate() {
        let axis = Vector::ith(k, 1.0);
        let r = 0.045 * length;
        mesh.cylinder(Vector::zeros(), axis * (0.78 * length), r, 8, paint);
        let head = [(0.0, 0.0), (0.0, 2.4 * r), (0.26 * length, 0.0)];
        mesh.lathe(axis * (0.76 * length), axis, &head, 12, false, |_| paint);
    }
}

/// Present point of the reference.
pub fn point(mesh: &mut Mesh, radius: f32) {
    mesh.ellipsoid(Vector::zeros(), Vector::repeat(radius), 12, |_| POINT);
}

/// A reference path or a trail.
pub fn line(mesh: &mut Mesh, points: &[Vector], half: f32, trail: bool) {
    let paint = if trail { TRAIL } else { PATH };
    for pair in points.windows(2) {
        mesh.beam(pair[0], pair[1], half, paint);
    }
}

/// Jet of a thruster, opposite to the thrust; longer and redder with the fraction of the limit.
pub fn jet(mesh: &mut Mesh, thruster: &Thruster, thrust: f64) {
    let limit = thruster.limits[usize::from(thrust > 0.0)].abs();
    let share = if limit > 0.0 { (thrust.abs() / limit).min(1.0) as f32 } else { 0.0 };
    if !thrust.is_finite() || share < 5e-3 {
        return;
    }
    let away = if thrust > 0.0 { -thruster.axis } else { thruster.axis };
    let r = thruster.radius;
    let length = r * (0.8 + 9.0 * share);
    let paint = if share < 0.8 {
        WEAK.mix(STRONG, (2.5 * share - 1.0).max(0.0))
    } else {
        STRONG.mix(FULL, (share - 0.8) / 0.18)
    };
    let rings: [(f32, f32); 5] = [(0.0, 0.72), (0.15, 0.78), (0.45, 0.7), (0.8, 0.5), (1.0, 0.3)];
    let fade = [0.8, 0.8, 0.6, 0.25, 0.0];
    let profile: Vec<_> = rings.iter().map(|(z, width)| (z * length, width * r)).collect();
    let strength = 0.6 + 0.4 * share;
    mesh.lathe(thruster.position + away * (0.3 * r), away, &profile, 16, true, |i| paint.clear(fade[i] * strength));
}

/// Hash of two integers, in [0, 1).
fn hash(a: u32, b: u32) -> f32 {
    let mut x = a.wrapping_mul(0x9E37_79B9) ^ b.wrapping_mul(0x85EB_CA6B) ^ 0x27D4_EB2F;
    for _ in 0..2 {
        x = (x ^ (x >> 15)).wrapping_mul(0x2C1B_3C6D);
        x = (x ^ (x >> 12)).wrapping_mul(0x297A_2D39);
    }
    (x >> 8) as f32 / 16_777_216.0
}

/// Particles of limited lifetime that drift with the flow, within `reach` of the centre. `origin` is the world's.
pub fn flow(mesh: &mut Mesh, current: &Vector, time: f64, origin: &Vector, reach: f32, floor: f32) {
    const COUNT: u32 = 150;
    const LIFE: f64 = 3.0;
    let speed = current.norm();
    // Particles are long enough to be visible in front of the vehicle.
    let along = if speed > 1e-4 { current / speed } else { Vector::z() };
    let [u, v] = across(&along);
    let side = 2.0 * reach;
    for mote in 0..COUNT {
        let age = time / LIFE + f64::from(hash(mote, 0));
        let (life, share) = (age.floor(), (age - age.floor()) as f32);
        let key = 1 + 3 * (life.rem_euclid(1e6) as u32);
        // Positions are fixed in the world; those in the box about the centre are shown.
        let place = Vector::from_fn(|k, _| {
            let at = origin[k] + side * hash(mote, key + k as u32) + reach;
            at.rem_euclid(side) - reach
        });
        let place = place + current * ((share - 0.5) * LIFE as f32);
        if place.z < floor {
            continue;
        }
        let alpha = 0.75 * (4.0 * share).min(4.0 - 4.0 * share).min(1.0);
        let thin = 0.0032 * reach * (0.6 + 0.8 * hash(mote, 9_999_991));
        let long = thin + 0.42 * speed;
        let paint = FLOW.clear(alpha);
        let head = place + along * long;
        // A dart: blunt front, tapered rear.
        let waist = place + along * (long - (3.0 * thin).min(long));
        let ring = [u, v, -u, -v].map(|out| waist + out * thin);
        for k in 0..4 {
            let (a, b) = (ring[k], ring[(k + 1) % 4]);
            mesh.polygon(&[a, b, head], paint);
            mesh.polygon(&[b, a, place], paint.clear(0.8 * alpha));
        }
    }
}

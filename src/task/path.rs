//! Reference paths of an end effector: position and attitude.
//!
//! One formula covers all kinds, so that instances on different kinds share a kernel:
//!
//! ```text
//! X(theta) = shift + sum_(h = 1, 2) (a_h sin(h theta) + b_h cos(h theta)) + sum_k c_k B(K theta / 2 pi - k)
//! ```
//!
//! with the cubic B-spline B and six coordinates X: position and rotation vector against the start, both in world axes.
//! A path is closed and twice continuously differentiable. Its phase theta leaves rest by a smooth ramp.

use std::f64::consts::{PI, TAU};

use nalgebra::{Vector3, Vector6};
use serde::{Deserialize, Serialize};

use super::ee_track::EETrack;
use super::pose::Pose;
use super::random::Stream;
use crate::lane::{Lane, Rows, sin_cos};
use crate::lie::{self, exp_se3};

/// Kinds of paths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PathKind {
    /// A fixed pose: the end effector's at home.
    Point,
    /// A line, back and forth.
    Line,
    /// A circle.
    Circle,
    /// A figure eight.
    FigureEight,
    /// A closed spline through random places.
    Spline,
    /// One of the other kinds, drawn for each episode.
    #[default]
    Mixed,
}

/// Duration of the ramp from rest, s.
const RAMP: f64 = 3.0;
/// Harmonics of the phase.
const HARMONICS: usize = 2;
/// Control points of the spline.
const KNOTS: usize = 8;
/// Radius of the ball of the spline's control points, relative to the path's size; the curve stays well within.
pub const KNOT_RADIUS: f64 = 1.5;
/// Maximum rotation out of the horizontal, relative to that about the vertical.
const TILT: f64 = 0.3;
/// Maximum angular speed, rad/s.
pub const TURN_SPEED: f64 = 0.3;
/// Phases at which the maximum speed is searched.
const SAMPLES: u32 = 256;

/// Numbers of a path: offsets from its first row.
const BASE: usize = 0;
/// First row of the shift to the start.
pub const SHIFT: usize = BASE + 9;
/// Row of the phase on the path.
pub const PHASE: usize = SHIFT + 6;
const REACH: usize = PHASE + 1;
/// Row of the progress of the start, from 0 to 1.
pub const PROGRESS: usize = REACH + 1;
const RATE: usize = PROGRESS + 1;
/// First row of the amplitudes of the harmonics.
pub const WAVES: usize = RATE + 1;
const SPLINE: usize = WAVES + 12 * HARMONICS;
/// Numbers of a path.
pub const PATH: usize = SPLINE + 6 * KNOTS;

/// A point of a path.
#[derive(Debug, Clone, Copy)]
pub struct PathPoint<L> {
    /// Pose in the world.
    pub pose: lie::Pose<L>,
    /// Velocity of its origin, world axes, m/s.
    pub velocity: lie::Vector3<L>,
    /// Angular velocity, world axes, rad/s.
    pub turning: lie::Vector3<L>,
}

/// Point of the path in rows from `row` on, `ahead` periods from now; `frequency` is the number of periods per second.
#[inline(always)]
pub fn path_point<L: Lane>(memory: &Rows<'_, L::Real>, row: usize, ahead: L, frequency: L) -> PathPoint<L> {
    let (phase, pace) = phase::<L>(memory, row, ahead);
    let (x, slope) = coordinates::<L>(memory, row, phase);
    let pace = pace * frequency;
    let (x, slope) = (lie::Vector6::from_array(x), lie::Vector6::from_array(slope));
    // The left Jacobian of the rotation vector turns its rate into an angular velocity, as it does in the exponential.
    let turn = exp_se3(lie::Vector6 { linear: slope.angular.scale(pace), angular: x.angular });
    let [xx, xy, xz, yx, yy, yz, zx, zy, zz] = memory.get_all(row + BASE);
    let base = lie::Matrix3([[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]]);
    PathPoint {
        pose: lie::Pose { rotation: turn.rotation.times(&base), position: x.linear },
        velocity: slope.linear.scale(pace),
        turning: turn.position,
    }
}

/// Places along the closed path in rows from `row` on, at these numbers of turns from its start.
pub fn path_places(memory: &Rows<'_, f64>, row: usize, around: impl Iterator<Item = f64>) -> Vec<[f64; 3]> {
    let place = |turns: f64| {
        let ([x, y, z, ..], _) = coordinates::<f64>(memory, row, TAU * turns);
        [x, y, z]
    };
    around.map(place).collect()
}

/// Advances the path in rows from `row` on by a period.
#[inline(always)]
pub fn path_advance<L: Lane>(memory: &mut Rows<'_, L::Real>, row: usize) {
    let one = L::c(1.0);
    let (phase, _) = phase::<L>(memory, row, one);
    // Within half a turn, so that it stays exact in episodes of any length, even in single precision.
    let turns = (phase * L::c(1.0 / TAU)).round();
    memory.set(row + PHASE, turns.neg_mul_add(L::c(TAU), phase));
    let progress = memory.get::<L>(row + PROGRESS) + memory.get::<L>(row + RATE);
    memory.set(row + PROGRESS, progress.min(one));
}

/// Phase, and its growth per period at that time.
#[inline(always)]
fn phase<L: Lane>(memory: &Rows<'_, L::Real>, row: usize, ahead: L) -> (L, L) {
    let [phase, reach, progress, rate] = memory.get_all(row + PHASE);
    let later = ahead.mul_add(rate, progress);
    let x = later.min(L::c(1.0));
    let slope = x * x * x * x.mul_add(x.mul_add(L::c(6.0), L::c(-15.0)), L::c(10.0));
    ((climb(later) - climb(progress)).mul_add(reach, phase), reach * rate * slope)
}

/// Antiderivative of the ramp `10 x^3 - 15 x^4 + 6 x^5`, which is 1 from x = 1 on.
#[inline(always)]
fn climb<L: Lane>(x: L) -> L {
    let one = L::c(1.0);
    let y = x.min(one);
    let square = y * y;
    square * square * y.mul_add(y + L::c(-3.0), L::c(2.5)) + (x - one).max(L::zero())
}

/// The six coordinates at a phase, and their derivatives by it.
#[inline(always)]
fn coordinates<L: Lane>(memory: &Rows<'_, L::Real>, row: usize, phase: L) -> ([L; 6], [L; 6]) {
    let mut x: [L; 6] = memory.get_all(row + SHIFT);
    let mut slope = [L::zero(); 6];
    for h in 0..HARMONICS {
        let order = L::c((h + 1) as f64);
        let (sine, cosine) = sin_cos(phase * order);
        let a: [L; 6] = memory.get_all(row + WAVES + 12 * h);
        let b: [L; 6] = memory.get_all(row + WAVES + 12 * h + 6);
        let (up, down) = (cosine * order, -(sine * order));
        for k in 0..6 {
            x[k] = a[k].mul_add(sine, b[k].mul_add(cosine, x[k]));
            slope[k] = a[k].mul_add(up, b[k].mul_add(down, slope[k]));
        }
    }
    let (zero, count) = (L::zero(), KNOTS as f64);
    let place = phase * L::c(count / TAU);
    for knot in 0..KNOTS {
        let offset = place - L::c(knot as f64);
        let offset = (offset * L::c(1.0 / count)).round().neg_mul_add(L::c(count), offset);
        let (outer, inner) = ((L::c(2.0) - offset.abs()).max(zero), (L::c(1.0) - offset.abs()).max(zero));
        let (wide, narrow) = (outer * outer, inner * inner);
        let weight = (wide * outer - narrow * inner * L::c(4.0)) * L::c(1.0 / 6.0);
        let fall = (wide - narrow * L::c(4.0)) * L::c(0.5 * count / TAU);
        let change = L::select(offset.lt(zero), fall, -fall);
        let control: [L; 6] = memory.get_all(row + SPLINE + 6 * knot);
        for k in 0..6 {
            x[k] = control[k].mul_add(weight, x[k]);
            slope[k] = control[k].mul_add(change, slope[k]);
        }
    }
    (x, slope)
}

/// Draws the numbers of a path that starts at rest at `start`; `up` is the vertical, `tilt` the maximum amplitude of
/// rotation out of the horizontal, rad, `period` the control period, s.
///
/// Its maximum speed is 50 to 100 % of the task's, its angular speed at most [`TURN_SPEED`].
pub fn draw_path(
    task: &EETrack,
    start: &Pose,
    up: &Vector3<f64>,
    tilt: f64,
    period: f64,
    draw: &Stream,
) -> [f64; PATH] {
    let kinds = [PathKind::Point, PathKind::Line, PathKind::Circle, PathKind::FigureEight, PathKind::Spline];
    let kind = match task.reference {
        PathKind::Mixed => kinds[(draw.uniform(0) * kinds.len() as f64) as usize],
        kind => kind,
    };
    let mut numbers = [0.0; PATH];
    let rotation = start.rotation.transpose();
    numbers[BASE..SHIFT].copy_from_slice(rotation.as_slice());
    numbers[RATE] = period / RAMP;

    let size = task.reference_size * draw.uniform_in(1, 0.5, 1.0);
    let along = draw.unit_vector(2);
    let other = draw.unit_vector(3);
    let across = along.cross(&other).try_normalize(1e-9).unwrap_or_else(|| along.cross(up));
    // About the vertical, and less out of it.
    let maximum = tilt.min(TILT * task.reference_rotation);
    let turn = |at: u32| {
        let axis = draw.unit_vector(at);
        (axis - up * axis.dot(up)) * maximum
            + up * draw.uniform_in(at + 1, -task.reference_rotation, task.reference_rotation)
    };
    let six = |x: Vector3<f64>, w: Vector3<f64>| Vector6::new(x.x, x.y, x.z, w.x, w.y, w.z);
    let zero = Vector3::zeros();
    let waves = match kind {
        PathKind::Line => [six(along * size, turn(4)), six(zero, turn(6)), Vector6::zeros(), Vector6::zeros()],
        PathKind::Circle => {
            [six(along * size, turn(4)), six(across * size, turn(6)), Vector6::zeros(), Vector6::zeros()]
        }
        PathKind::FigureEight => {
            [six(along * size, turn(4)), six(zero, turn(6)), six(across * (0.5 * size), zero), Vector6::zeros()]
        }
        _ => [Vector6::zeros(); 4],
    };
    for (k, wave) in waves.iter().enumerate() {
        numbers[WAVES + 6 * k..][..6].copy_from_slice(wave.as_slice());
    }
    if kind == PathKind::Spline {
        for k in 0..KNOTS as u32 {
            let radius = KNOT_RADIUS * size * draw.uniform(8 + 4 * k).cbrt();
            let knot = six(draw.unit_vector(9 + 4 * k) * radius, turn(10 + 4 * k));
            numbers[SPLINE + 6 * k as usize..][..6].copy_from_slice(knot.as_slice());
        }
    }

    let [mut fastest, mut turning] = [0.0f64; 2];
    for k in 0..SAMPLES {
        let (_, slope) = coordinates(&Rows::of_one(&mut numbers), 0, TAU * f64::from(k) / f64::from(SAMPLES));
        let slope = Vector6::from(slope);
        fastest = fastest.max(slope.fixed_rows::<3>(0).norm());
        turning = turning.max(slope.fixed_rows::<3>(3).norm());
    }
    let speed = task.reference_speed * draw.uniform_in(40, 0.5, 1.0);
    let pace = (speed / fastest).min(TURN_SPEED / turning);
    numbers[REACH] = if pace.is_finite() { pace * RAMP } else { 0.0 };
    let phase = draw.uniform_in(41, -PI, PI);
    numbers[PHASE] = phase;
    let (begin, _) = coordinates::<f64>(&Rows::of_one(&mut numbers), 0, phase);
    for k in 0..6 {
        numbers[SHIFT + k] = if k < 3 { start.position[k] } else { 0.0 } - begin[k];
    }
    numbers
}

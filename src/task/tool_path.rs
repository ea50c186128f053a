//! Reference of a tool that works on a fixture: advances along an axis and turns about it.

use nalgebra as na;

use super::pose::Pose;
use crate::lane::{Lane, Real, sin_cos};
use crate::lie::{self, Matrix3, Vector3, Vector6};

/// A part of the motion, which begins and ends at rest with zero acceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stroke {
    /// Time of its start, s.
    pub start: f64,
    /// Duration, s.
    pub duration: f64,
    /// Advance along the axis, m.
    pub advance: f64,
    /// Turn about the axis, rad.
    pub turn: f64,
}

/// The path of an end effector: `origin + axis s(t) + R(axis, theta(t)) lever`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ToolPath {
    /// Axis, world axes, of length 1.
    pub axis: na::Vector3<f64>,
    /// Point on the axis at the start, m.
    pub origin: na::Vector3<f64>,
    /// End effector from there at the start, m; it turns about the axis.
    pub lever: na::Vector3<f64>,
    /// Attitude at the start.
    pub rotation: na::Matrix3<f64>,
    /// True if the attitude turns about the axis, too.
    pub turns: bool,
    /// Strokes; they may overlap.
    pub strokes: Vec<Stroke>,
}

/// [`ToolPath`] in the precision of the lanes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ToolPathKernel<T> {
    axis: [T; 3],
    origin: [T; 3],
    lever: [T; 3],
    rotation: [[T; 3]; 3],
    turns: bool,
    /// Start, one over the duration, advance and turn of each stroke.
    strokes: Vec<[T; 4]>,
}

/// A point of the path.
pub(super) struct ToolPoint<L> {
    pub pose: lie::Pose<L>,
    /// Velocity of the origin and angular velocity, world axes.
    pub velocity: Vector6<L>,
}

impl ToolPath {
    pub fn kernel<T: Real>(&self) -> ToolPathKernel<T> {
        let vector = |v: na::Vector3<f64>| <[f64; 3]>::from(v).map(T::from_f64);
        let Matrix3(rotation) = Pose { rotation: self.rotation, ..Pose::default() }.in_lanes().rotation;
        let stroke = |s: &Stroke| [s.start, 1.0 / s.duration.max(1e-3), s.advance, s.turn].map(T::from_f64);
        ToolPathKernel {
            axis: vector(self.axis),
            origin: vector(self.origin),
            lever: vector(self.lever),
            rotation: rotation.map(|row| row.map(T::from_f64)),
            turns: self.turns,
            strokes: self.strokes.iter().map(stroke).collect(),
        }
    }
}

impl<T: Real> ToolPathKernel<T> {
    /// The point at a time since the start, s.
    #[inline(always)]
    pub fn at<L: Lane<Real = T>>(&self, time: L) -> ToolPoint<L> {
        let zero = L::zero();
        let (mut advance, mut speed, mut angle, mut rate) = (zero, zero, zero, zero);
        for k in 0..self.strokes.len() {
            let [start, frequency, by, turn] = self.strokes[k];
            let x = ((time - L::splat(start)) * L::splat(frequency)).min(L::c(1.0)).max(zero);
            let (square, rest) = (x * x, L::c(1.0) - x);
            // 10 x^3 - 15 x^4 + 6 x^5 and its slope.
            let share = square * x * x.mul_add(x.mul_add(L::c(6.0), L::c(-15.0)), L::c(10.0));
            let slope = square * (rest * rest) * (L::splat(frequency) * L::c(30.0));
            advance = share.mul_add(L::splat(by), advance);
            speed = slope.mul_add(L::splat(by), speed);
            angle = share.mul_add(L::splat(turn), angle);
            rate = slope.mul_add(L::splat(turn), rate);
        }
        let (axis, lever) = (splat(&self.axis), splat(&self.lever));
        let (sin, cos) = sin_cos(angle);
        let lever = turned(axis, lever, sin, cos);
        let position = splat(&self.origin) + axis.scale_add(advance, lever);
        let mut rotation =
            Matrix3([splat(&self.rotation[0]).0, splat(&self.rotation[1]).0, splat(&self.rotation[2]).0]);
        let mut angular = Vector3::zero();
        if self.turns {
            // By columns.
            let columns = rotation.transposed().0;
            let mut turning = Matrix3::identity();
            for k in 0..3 {
                turning.0[k] = turned(axis, Vector3(columns[k]), sin, cos).0;
            }
            rotation = turning.transposed();
            angular = axis.scale(rate);
        }
        let linear = axis.cross(lever).scale_add(rate, axis.scale(speed));
        ToolPoint { pose: lie::Pose { rotation, position }, velocity: Vector6 { linear, angular } }
    }
}

#[inline(always)]
fn splat<L: Lane>(v: &[L::Real; 3]) -> Vector3<L> {
    Vector3([L::splat(v[0]), L::splat(v[1]), L::splat(v[2])])
}

/// A vector, turned about an axis of length 1 by an angle of this sine and cosine.
#[inline(always)]
fn turned<L: Lane>(axis: Vector3<L>, v: Vector3<L>, sin: L, cos: L) -> Vector3<L> {
    let along = axis.dot(v) * (L::c(1.0) - cos);
    axis.cross(v).scale_add(sin, axis.scale_add(along, v.scale(cos)))
}

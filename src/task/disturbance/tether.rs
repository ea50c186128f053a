//! A cable from a fixed point to the vehicle.

use super::column::Column;
use super::component::{Component, Draws, Forcing, Moment, Place, component};
use super::span::Span;
use crate::lane::{Lane, Real, Rows};
use crate::lie::{Vector3, Vector6};

component! {
    /// A cable from a fixed point (such as at the surface) to a point of the vehicle, in quasi-static equilibrium: its inertia
    /// is neglected.
    ///
    /// Current and net weight load it evenly along its chord: per metre `q = 1/2 rho C_D d |u| u - w up`, where u is the part
    /// across the chord of the water's velocity against the cable, whose speed is half the speed of the vehicle's point. The
    /// vehicle bears half of that load, and the tension along the chord c that a parabola of the cable's length L takes,
    /// `|q_n| c / sqrt(24 (L/c - 1))`, with at least 0.5 % of slack in this; a chord longer than the
    /// cable stretches a spring.
    pub struct Tether = "tether" {
        /// Height of the fixed point above the world origin, m; negative if it lies below.
        height: Span = Span::of(5.0, 15.0), in -1e3, 1e3;
        /// Horizontal distance of the fixed point from the world origin, m.
        distance: Span = Span::of(0.0, 8.0), in 0.0, 1e3;
        /// Length over the distance from the fixed point to the world origin, minus 1.
        slack: Span = Span::of(0.02, 0.1), in 0.0, 10.0;
        /// Diameter, m.
        diameter: f64 = 0.01, in 0.0, 0.5;
        /// Drag coefficient across the cable.
        drag: f64 = 1.2, in 0.0, 10.0;
        /// Weight in water, N per metre; negative if it floats.
        weight: Span = Span::of(-0.3, 0.3), in -100.0, 100.0;
        /// Stiffness of the stretched cable: share of the maximum thrust along the weakest axis, per metre.
        stiffness: f64 = 0.5, in 0.0, 2.0;
        /// Attachment to the vehicle, body axes, m.
        attachment: [f64; 3] = [0.0; 3], in -10.0, 10.0;
    }
}

/// Minimum slack that counts for the tension.
const TAUT: f64 = 5e-3;
/// Minimum length of the chord, m.
const SHORTEST: f64 = 0.1;

impl Component for Tether {
    const STREAM: u32 = 36;
    /// Fixed point (3), attachment (3), length, drag `1/2 rho C_D d`, weight, stiffness.
    const ROWS: usize = 10;

    fn begin<T: Real>(&self, memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let Draws { stream: draw, context, .. } = draws;
        let uniform = |k| draw.uniform(k);
        let horizontal = context.direction([uniform(0), 0.5], 0.0) * self.distance.at(uniform(1));
        let [x, y, z] = (horizontal + context.level[2] * self.height.at(uniform(2))).into();
        let distance = [x, y, z].iter().map(|x: &f64| x * x).sum::<f64>().sqrt();
        let length = distance.max(SHORTEST) * (1.0 + self.slack.at(uniform(3)));
        let drag = 0.5 * context.density * self.drag * self.diameter;
        let [px, py, pz] = self.attachment;
        let stiffness = self.stiffness * context.thrust;
        memory.set_all(at.row, [x, y, z, px, py, pz, length, drag, self.weight.at(uniform(4)), stiffness]);
    }

    /// Adds its wrench in the water's velocity so far.
    #[inline(always)]
    fn add<L: Lane>(memory: &Rows<'_, L::Real>, at: Place, moment: &Moment<'_, L>, forcing: &mut Forcing<L>) {
        let Moment { pose, twist, level: [_, _, up], .. } = moment;
        let [x, y, z, px, py, pz, length, drag, weight, stiffness]: [L; Self::ROWS] = memory.get_all(at.row);
        let point = Vector3([px, py, pz]);
        let chord = Vector3([x, y, z]) - (pose.position + pose.rotation.apply(point));
        let distance = chord.dot(chord).sqrt().max(L::c(SHORTEST));
        let (one, along) = (L::c(1.0), chord.scale(L::c(1.0) / distance));
        let carried = pose.rotation.apply(twist.linear + twist.angular.cross(point));
        let flow = across(forcing.velocity - carried.scale(L::c(0.5)), along);
        let load = flow.scale(drag * flow.dot(flow).sqrt()) - up.scale(weight);
        let normal = across(load, along);
        let slack = (length / distance - one).max(L::c(TAUT));
        let tension = normal.dot(normal).sqrt() * distance / (slack * L::c(24.0)).sqrt();
        let stretch = (distance - length).max(L::zero());
        let force = load.scale(length * L::c(0.5)) + along.scale(stiffness.mul_add(stretch, tension));
        let force = pose.rotation.apply_transposed(force);
        forcing.wrench = forcing.wrench + Vector6 { linear: force, angular: point.cross(force) };
    }
}

/// The part of a vector across a direction.
#[inline(always)]
fn across<L: Lane>(v: Vector3<L>, along: Vector3<L>) -> Vector3<L> {
    v - along.scale(v.dot(along))
}

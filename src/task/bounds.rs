//! Bounds of the state; an episode that leaves them has diverged.

use super::pose::{Pose, StageState};
use crate::lane::Lane;
use crate::lie::Vector3;
use crate::system::State;

/// Maximum distance from the target, m.
pub(super) const POSITION_BOUND: f64 = 10.0;
/// Maximum linear speed, m/s.
pub(super) const SPEED_BOUND: f64 = 10.0;
/// Maximum angular speed, rad/s.
pub(super) const TURN_BOUND: f64 = 20.0;
/// Maximum joint rate, rad/s or m/s.
pub(super) const RATE_BOUND: f64 = 20.0;

/// First bound that a state reaches, if any: name, value and bound. `frame` is the pose of the task's frame, `target` its
/// target, `joints` the number of joints.
pub(super) fn violation(frame: &Pose, target: &Pose, state: &State, joints: usize) -> Option<(&'static str, f64, f64)> {
    let twist = &state.twist;
    let bounded = [
        ("distance from the target", (frame.position - target.position).norm(), POSITION_BOUND),
        ("linear speed", twist.fixed_rows::<3>(0).norm(), SPEED_BOUND),
        ("angular speed", twist.fixed_rows::<3>(3).norm(), TURN_BOUND),
    ];
    let attitude = state.rotation.iter().map(|x| ("attitude", x.abs(), f64::INFINITY));
    let rates = state.qd[..joints].iter().map(|x| ("joint rate", x.abs(), RATE_BOUND));
    let coordinates = state.q[..joints].iter().map(|x| ("joint coordinate", x.abs(), f64::INFINITY));
    let mut all = bounded.into_iter().chain(attitude).chain(rates).chain(coordinates);
    all.find(|(_, value, bound)| value.is_nan() || value >= bound)
}

/// Instances whose velocities are within bounds and whose attitude and `joints` joint coordinates are finite. `near` holds
/// where the position is within its bound.
#[inline(always)]
pub(super) fn in_bounds<L: Lane>(near: L::Mask, state: &StageState<L>, joints: usize) -> L::Mask {
    let mut mask = L::and(near, shorter(state.twist.linear, SPEED_BOUND));
    mask = L::and(mask, shorter(state.twist.angular, TURN_BOUND));
    // Zero times each number: NaN for one that is not finite.
    let mut sum = L::zero();
    for row in state.pose.rotation.0 {
        for k in 0..3 {
            sum = row[k].mul_add(L::zero(), sum);
        }
    }
    let mut fastest = L::zero();
    for i in 0..joints {
        sum = state.q[i].mul_add(L::zero(), sum);
        sum = state.qd[i].mul_add(L::zero(), sum);
        fastest = fastest.max(state.qd[i].abs());
    }
    L::and(mask, L::and(fastest.lt(L::c(RATE_BOUND)), sum.lt(L::c(1.0))))
}

/// Instances whose vector is shorter than `bound`.
#[inline(always)]
pub(super) fn shorter<L: Lane>(v: Vector3<L>, bound: f64) -> L::Mask {
    v.dot(v).lt(L::c(bound * bound))
}

/// Length of a vector, at most `bound`; NaN counts as the bound.
#[inline(always)]
pub(super) fn bounded_length<L: Lane>(v: Vector3<L>, bound: f64) -> L {
    v.dot(v).sqrt().min(L::c(bound))
}

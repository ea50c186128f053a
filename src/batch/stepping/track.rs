//! The motion along which a companion has followed an instance, and the error relative to it.

use crate::batch::monitoring::step_quality::{KNOWN_LIMIT, maximum};
use crate::system::{JOINTS, State};

/// Minimum scale of a motion, m, rad, m/s or rad/s: errors of smaller motions are set against this.
const MIN_SCALE: f64 = 1e-3;
/// Maximum scale of rotation and joint travel, rad or m.
const MAX_ANGLE: f64 = 1.0;
/// Time, s, in which the scales of a motion are still small: errors have the limit of known ones there.
const BEGINNING: f64 = 0.3;

/// Divisor of the differences of a method of this order.
pub fn divisor(order: usize) -> f64 {
    let divisor = |order: usize| 1.0 - 0.5_f64.powi(order as i32);
    (divisor(order).powi(2) * divisor(2)).cbrt()
}

/// Motion that a companion has followed.
#[derive(Debug, Clone)]
pub struct Track {
    /// Stage of following.
    pub stage: Stage,
    /// True where the numbers that the instance has of its own are to be copied.
    pub own_stale: bool,
    /// State at the start.
    pub start: State,
    /// Maximum distance (m), rotation (rad) and joint travel (rad or m) from there, and maximum speed (m/s), spin (rad/s) and
    /// joint rate (rad/s or m/s).
    pub scales: [f64; 6],
    /// Estimated error relative to these.
    pub relative: f64,
    /// Time, s.
    pub time: f64,
}

/// Stage of following.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stage {
    /// The companion copies the state of the instance before the next step.
    Fresh,
    /// It has been given the same state, to more digits.
    Given,
    /// It follows.
    Follows,
}

impl Track {
    /// Before the first step from a state.
    pub fn new(stage: Stage, start: State) -> Self {
        Self { stage, own_stale: true, start, scales: [0.0; 6], relative: 0.0, time: 0.0 }
    }

    /// Changes the parts of a companion's state in which two states of its instance differ, and the start along with them: the
    /// way from there stays as it was.
    pub fn change(&mut self, companion: &mut State, from: &State, to: &State) {
        if to.position != from.position {
            self.start.position += to.position - companion.position;
            companion.position = to.position;
        }
        if to.rotation != from.rotation {
            self.start.rotation = to.rotation * companion.rotation.transpose() * self.start.rotation;
            companion.rotation = to.rotation;
        }
        if to.twist != from.twist {
            companion.twist = to.twist;
        }
        for k in 0..JOINTS {
            if to.q[k] != from.q[k] {
                self.start.q[k] += to.q[k] - companion.q[k];
                companion.q[k] = to.q[k];
            }
            if to.qd[k] != from.qd[k] {
                companion.qd[k] = to.qd[k];
            }
        }
        (companion.thrust, companion.time) = (to.thrust, to.time);
    }

    /// Takes a state into the scales of the motion.
    pub fn widen(&mut self, state: &State, joints: usize) {
        let start = &self.start;
        let [linear, angular] = speeds(state);
        let mut motion = [(state.position - start.position).norm(), turn(state, start), 0.0, linear, angular, 0.0];
        for k in 0..joints {
            motion[2] = (state.q[k] - start.q[k]).abs().max(motion[2]);
            motion[5] = state.qd[k].abs().max(motion[5]);
        }
        for (scale, motion) in self.scales.iter_mut().zip(motion) {
            *scale = scale.max(motion);
        }
    }

    /// True where the error exceeds a limit, which is higher in the beginning.
    pub fn beyond(&self, limit: f64) -> bool {
        let limit = if self.time < BEGINNING { limit.max(KNOWN_LIMIT) } else { limit };
        limit.is_finite() && (self.relative >= limit || self.relative.is_nan())
    }

    /// Error of a state relative to the scales, from the companion's. NaN where either is not finite. The velocities count where
    /// they are `smooth`: at an impact a small error of its time is a large one of the velocities, which is over with the impact.
    pub fn compare(&mut self, state: &State, other: &State, joints: usize, divisor: f64, smooth: bool) {
        self.widen(state, joints);
        self.widen(other, joints);
        let difference = State { twist: other.twist - state.twist, ..State::default() };
        let [linear, angular] = speeds(&difference);
        let mut errors = [(other.position - state.position).norm(), turn(state, other), 0.0, linear, angular, 0.0];
        for k in 0..joints {
            errors[2] = maximum(errors[2], (other.q[k] - state.q[k]).abs());
            errors[5] = maximum(errors[5], (other.qd[k] - state.qd[k]).abs());
        }
        let mut relative = 0.0;
        let compared = if smooth { errors.len() } else { 3 };
        for (k, (error, scale)) in errors.into_iter().zip(self.scales).take(compared).enumerate() {
            let scale = if k == 1 || k == 2 { scale.min(MAX_ANGLE) } else { scale };
            relative = maximum(relative, error / scale.max(MIN_SCALE));
        }
        self.relative = relative / divisor;
    }
}

/// Linear and angular speed, m/s and rad/s.
fn speeds(state: &State) -> [f64; 2] {
    [state.twist.fixed_rows::<3>(0).norm(), state.twist.fixed_rows::<3>(3).norm()]
}

/// Angle between two attitudes, for small ones: the norm of their difference over the root of 2, 2 sin of half the angle.
fn turn(a: &State, b: &State) -> f64 {
    (a.rotation - b.rotation).norm() * std::f64::consts::FRAC_1_SQRT_2
}

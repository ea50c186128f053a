//! The reward that all tasks share.
//!
//! With the pose error `p = sqrt(|e|^2 + (0.5 m angle)^2)` it is
//! `-w_pose (ln(1 + (p / s)^2) + p / c) - w_effort mean(u^2) - w_rate mean((a - a_prev)^2) - w_diverged`, the last term
//! only where the state diverged. u are relative thrusts and torques, a actions; c is 0.3 m unless the task says otherwise.

use super::settings::settings;
use crate::control::ATTITUDE_LEVER;
use crate::lane::{Lane, Real, ln_1p};

/// Pose error at which the linear part is 1, m.
pub(super) const COARSE: f64 = 0.3;

settings! {
    /// Weights of the reward's terms, and the scale of the pose error.
    pub struct RewardWeights {
        /// Weight of the pose error.
        pose: f64 = 0.1;
        /// Pose error s at which the logarithm bends, m. It is the user's accuracy, not the vehicle's size: no scene scales it.
        pose_scale: f64 = 0.02;
        /// Weight of the mean squared relative thrust and torque.
        effort: f64 = 0.02;
        /// Weight of the mean squared change of the action.
        action_rate: f64 = 0.1;
        /// Cost of divergence.
        diverged: f64 = 0.0;
    }
}

impl RewardWeights {
    /// Names and values of the weights.
    pub(super) fn named(&self) -> [(&'static str, f64); 4] {
        [
            ("reward.pose", self.pose),
            ("reward.effort", self.effort),
            ("reward.action_rate", self.action_rate),
            ("reward.diverged", self.diverged),
        ]
    }
}

/// Weights in the precision of the lanes, with their signs; the weight of the action's change is per entry.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RewardKernel<T> {
    pose: T,
    effort: T,
    action_rate: T,
    diverged: T,
    /// s^-2.
    inverse_square: T,
    inverse_linear: T,
}

/// Terms of the reward.
#[derive(Debug, Clone, Copy)]
pub(super) struct RewardTerms<L> {
    pub pose: L,
    pub effort: L,
    pub action_rate: L,
    pub diverged: L,
}

/// Square of the pose error, m^2, of a distance (m) and an angle (rad).
#[inline(always)]
pub(super) fn squared_pose_error<L: Lane>(position: L, angle: L) -> L {
    let angle = angle * L::c(ATTITUDE_LEVER);
    position.mul_add(position, angle * angle)
}

impl<T: Real> RewardKernel<T> {
    /// For actions with this number of entries, and a pose error at which the linear part is 1, m.
    pub fn new(weights: &RewardWeights, actions: usize, linear_scale: f64) -> Self {
        let number = T::from_f64;
        Self {
            pose: number(-weights.pose),
            effort: number(-weights.effort),
            action_rate: number(-weights.action_rate / actions as f64),
            diverged: number(-weights.diverged),
            inverse_square: number(1.0 / (weights.pose_scale * weights.pose_scale)),
            inverse_linear: number(1.0 / linear_scale),
        }
    }

    /// Terms for a squared pose error (m^2), the actuators' mean square, the action's squared change and the instances
    /// within their bounds.
    #[inline(always)]
    pub fn terms<L: Lane<Real = T>>(
        &self,
        squared_error: L,
        effort: L,
        change: L,
        in_bounds: L::Mask,
    ) -> RewardTerms<L> {
        let cost = squared_error
            .sqrt()
            .mul_add(L::splat(self.inverse_linear), ln_1p(squared_error * L::splat(self.inverse_square)));
        RewardTerms {
            pose: cost * L::splat(self.pose),
            effort: effort * L::splat(self.effort),
            action_rate: change * L::splat(self.action_rate),
            diverged: L::select(in_bounds, L::zero(), L::splat(self.diverged)),
        }
    }
}

impl<L: Lane> RewardTerms<L> {
    /// The reward.
    #[inline(always)]
    pub fn sum(&self) -> L {
        self.pose + self.effort + self.action_rate + self.diverged
    }
}

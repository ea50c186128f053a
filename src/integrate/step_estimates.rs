//! Estimates of the quality of the last steps: rates that the motion excites, and velocity errors.

use std::hint::cold_path;

use super::tableau::{Contrast, Tableau};
use crate::lane::{Lane, Real, unroll};
use crate::lie::{Vector3, Vector6};

/// Fraction of the sums that each sub-interval keeps.
const KEPT: f64 = 1.0 - 1.0 / 32.0;
/// Maximum `h |lambda|` in the error estimate: faster rates show as stiffness.
const FASTEST: f64 = 2.0;
/// Time over which errors of spinning add up, s: no damping removes them.
const SPIN_TIME: f64 = 10.0;
/// Minimum rotation within a sub-interval that counts as spinning, rad.
const SPIN: f64 = 0.02;
/// Speed that counts as rest, m/s and rad/s.
const REST: f64 = 1e-3;
/// Rounding of differences within a step over twice the unit round-off: smaller differences do not count, m and rad.
const ROUNDING: f64 = 100.0;

/// Estimates over the last thirty sub-intervals or so: sums that decay with each; all 0 at first.
#[derive(Debug, Clone, Copy)]
pub struct StepEstimates<L> {
    /// Sums of squared differences within a sub-interval, m and rad: of the stages' coordinates, of their velocities times h,
    /// and of the accelerations at them times h^2.
    pub contrast: [L; 3],
    /// Sum of the estimated velocity errors, as displacements over a sub-interval; and the maximum displacement over a
    /// sub-interval, decaying likewise. m and rad.
    pub velocity_error: [L; 2],
    /// Relative velocity error of spinning over the last ten seconds.
    pub spin_error: L,
    /// Sub-interval that an adaptive method plans next, as a fraction of the interval.
    pub planned: L,
}

impl<L: Lane> StepEstimates<L> {
    /// Initial values.
    #[inline(always)]
    pub fn zero() -> Self {
        let zero = L::zero();
        Self { contrast: [zero; 3], velocity_error: [zero; 2], spin_error: zero, planned: zero }
    }

    /// Records the differences between the stages of a sub-interval in the lanes that took it. Returns its estimated error, m
    /// and rad.
    #[inline(always)]
    pub(super) fn record_contrast(&mut self, taken: L::Mask, tableau: &Tableau, contrast: [L; 3]) -> L {
        unroll!(part in 0 1 2 => {
            let sum = self.contrast[part].mul_add(L::c(KEPT), contrast[part]);
            self.contrast[part] = L::select(taken, sum, self.contrast[part]);
        });
        let Some(Contrast { error: (factor, power), .. }) = tableau.contrast else { return L::zero() };
        let [_, speeds, changes] = self.contrast;
        let square = (changes / (speeds + L::c(rounding(L::Real::EPSILON).powi(2)))).min(L::c(FASTEST * FASTEST));
        let rate = match power {
            1 => square.sqrt(),
            2 => square,
            _ => square * square.sqrt(),
        };
        contrast[2].sqrt() * rate * L::c(factor)
    }

    /// Records the errors of a sub-interval of size `h`, from its estimated error and its squared rotation; a method of this
    /// order took it from one twist to another and to joint rates.
    #[inline(always)]
    pub(super) fn record_errors<const N: usize>(
        &mut self,
        taken: L::Mask,
        order: usize,
        (h, error, turn): (L, L, L),
        from: &Vector6<L>,
        (to, qd): (&Vector6<L>, &[L; N]),
        n: usize,
    ) {
        let [sum, maximum] = self.velocity_error;
        let error = sum.mul_add(L::c(KEPT), error);
        let way = (maximum * L::c(KEPT)).max(displacement(h, to, &qd[..n]));
        self.velocity_error = [L::select(taken, error, sum), L::select(taken, way, maximum)];
        let mut spin = (h * self.spin_error).neg_mul_add(L::c(1.0 / SPIN_TIME), self.spin_error);
        let spins = L::c(SPIN * SPIN).lt(turn);
        if L::any(spins) {
            cold_path();
            spin += L::select(spins, spin_error(order, turn, from, to), L::zero());
        }
        self.spin_error = L::select(taken, spin, self.spin_error);
    }
}

/// Displacement in a time `h` at these velocities, m and rad together.
#[inline(always)]
fn displacement<L: Lane>(h: L, twist: &Vector6<L>, qd: &[L]) -> L {
    let mut sum = twist.dot(*twist);
    for rate in qd {
        sum = rate.mul_add(*rate, sum);
    }
    sum.sqrt() * h
}

/// Relative velocity error of a sub-interval that turns by `theta`: `u theta^p / (p + 1)!` for order p, where u is the
/// relative change of linear or angular velocity in body axes. A steady spin has no error.
#[inline(always)]
fn spin_error<L: Lane>(order: usize, turn: L, from: &Vector6<L>, to: &Vector6<L>) -> L {
    let power = match order {
        1 => turn.sqrt() * L::c(1.0 / 2.0),
        2 => turn * L::c(1.0 / 6.0),
        3 => turn * turn.sqrt() * L::c(1.0 / 24.0),
        _ => turn * turn * L::c(1.0 / 120.0),
    };
    let linear = squared_change(from.linear, to.linear);
    let angular = squared_change(from.angular, to.angular);
    power * linear.max(angular).min(L::c(1.0)).sqrt()
}

/// Square of the relative change of a velocity; a change within rounding does not count.
#[inline(always)]
fn squared_change<L: Lane>(from: Vector3<L>, to: Vector3<L>) -> L {
    let change = to - from;
    change.dot(change) / (from.dot(from) + L::c(rounding(L::Real::EPSILON).powi(2)))
}

/// `h |lambda|` of the fastest rate that a motion excites, from its [`StepEstimates::contrast`]: for a single mode, real or
/// oscillating, the ratio of `h` times the right-hand side's change to the states' difference (on average over a period).
/// Rounding noise, which looks like a very fast rate where nothing moves, does not count.
#[inline(always)]
pub fn stiffness<L: Lane>([places, speeds, changes]: [L; 3], epsilon: f64) -> L {
    ((speeds + changes) / (places + speeds + L::c(rounding(epsilon).powi(2) / (1.0 - KEPT)))).sqrt()
}

/// Relative velocity error of the last steps of size `h`, from [`StepEstimates::velocity_error`] and
/// [`StepEstimates::spin_error`]; a motion slower than `REST` counts as one of that speed. NaN where any of them is not finite.
#[inline(always)]
pub fn step_error<L: Lane>([error, way, spin]: [L; 3], h: f64) -> L {
    (error / way.max(L::c(REST * h))).max(spin) + (error + way + spin) * L::zero()
}

#[inline(always)]
fn rounding(epsilon: f64) -> f64 {
    ROUNDING * epsilon
}

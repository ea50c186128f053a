//! What the pieces of a motion show besides its state: how fast the rates are that it excites, and what they get wrong.

use std::hint::cold_path;

use super::tableau::{Contrast, Tableau};
use crate::lane::{Lane, Real};
use crate::lie::{Vector3, Vector6};

/// Part of what was seen that a piece keeps.
const KEPT: f64 = 1.0 - 1.0 / 32.0;
/// Greatest `h |lambda|` that errors are estimated for: what is faster shows by itself.
const FASTEST: f64 = 2.0;
/// Time that errors of spinning count for, s: no damping takes them away.
const SPIN_TIME: f64 = 10.0;
/// Turn within a piece from which on spinning counts, rad.
const SPIN: f64 = 0.02;
/// Speed that counts as rest, m/s and rad/s.
const REST: f64 = 1e-3;
/// Rounding of differences within a step, by the unit round-off times two: they matter from here on, m and rad.
const ROUNDING: f64 = 100.0;

/// What was seen of a motion; all 0 at first. Sums leave a share behind with each piece, so that the last thirty count.
#[derive(Debug, Clone, Copy)]
pub struct Watch<L> {
    /// Sums of squares of how states within a piece differ (coordinates, velocities times h) and of how the accelerations
    /// at them do (times h^2), m and rad.
    pub contrast: [L; 3],
    /// Errors of the velocities, estimated and summed, as displacements over a piece; and the greatest displacement over a
    /// piece, fading likewise. m and rad.
    pub slip: [L; 2],
    /// Share of the velocities that spinning has got wrong in the last ten seconds, estimated.
    pub spin: L,
    /// Piece that an adaptive method plans next, by the interval.
    pub plan: L,
}

impl<L: Lane> Watch<L> {
    /// What all entries are at first.
    #[inline(always)]
    pub fn blank() -> Self {
        let zero = L::zero();
        Self { contrast: [zero; 3], slip: [zero; 2], spin: zero, plan: zero }
    }

    /// Takes note of a piece in the lanes that took it: how its stages differ. Its estimated error, m and rad.
    #[inline(always)]
    pub(super) fn compare(&mut self, taken: L::Mask, tableau: &Tableau, contrast: [L; 3]) -> L {
        for part in 0..3 {
            let sum = self.contrast[part].mul_add(L::c(KEPT), contrast[part]);
            self.contrast[part] = L::select(taken, sum, self.contrast[part]);
        }
        let Some(Contrast { slip: (factor, power), .. }) = tableau.contrast else { return L::zero() };
        let [_, speeds, changes] = self.contrast;
        let square = (changes / (speeds + L::c(rounding(L::Real::EPSILON).powi(2)))).min(L::c(FASTEST * FASTEST));
        let rate = match power {
            1 => square.sqrt(),
            2 => square,
            _ => square * square.sqrt(),
        };
        contrast[2].sqrt() * rate * L::c(factor)
    }

    /// Takes note of a piece of size `h` that a method of order `order` took from one twist to another and to joint rates:
    /// its estimated error and its squared turn.
    #[inline(always)]
    pub(super) fn judge<const N: usize>(
        &mut self,
        taken: L::Mask,
        order: usize,
        (h, error, turn): (L, L, L),
        from: &Vector6<L>,
        (to, qd): (&Vector6<L>, &[L; N]),
        n: usize,
    ) {
        let error = self.slip[0].mul_add(L::c(KEPT), error);
        let way = (self.slip[1] * L::c(KEPT)).max(way(h, to, &qd[..n]));
        self.slip = [L::select(taken, error, self.slip[0]), L::select(taken, way, self.slip[1])];
        let mut spin = (h * self.spin).neg_mul_add(L::c(1.0 / SPIN_TIME), self.spin);
        let spins = L::c(SPIN * SPIN).lt(turn);
        if L::any(spins) {
            cold_path();
            spin += L::select(spins, spun(order, turn, from, to), L::zero());
        }
        self.spin = L::select(taken, spin, self.spin);
    }
}

/// How far a motion goes in a time `h` at its velocities, m and rad together.
#[inline(always)]
fn way<L: Lane>(h: L, twist: &Vector6<L>, qd: &[L]) -> L {
    let mut sum = twist.dot(*twist);
    for rate in qd {
        sum = rate.mul_add(*rate, sum);
    }
    sum.sqrt() * h
}

/// Error of a piece that turns by `theta`, as a share of the velocities: `u theta^p / (p + 1)!` for order p, where u is the
/// share that linear or angular velocity changes by in body axes. A steady spin has no error at all.
#[inline(always)]
fn spun<L: Lane>(order: usize, turn: L, from: &Vector6<L>, to: &Vector6<L>) -> L {
    let power = match order {
        1 => turn.sqrt() * L::c(1.0 / 2.0),
        2 => turn * L::c(1.0 / 6.0),
        3 => turn * turn.sqrt() * L::c(1.0 / 24.0),
        _ => turn * turn * L::c(1.0 / 120.0),
    };
    let linear = changed(from.linear, to.linear);
    let angular = changed(from.angular, to.angular);
    power * linear.max(angular).min(L::c(1.0)).sqrt()
}

/// Square of the share of its length that a velocity changes by; a change within rounding is none.
#[inline(always)]
fn changed<L: Lane>(from: Vector3<L>, to: Vector3<L>) -> L {
    let change = to - from;
    change.dot(change) / (from.dot(from) + L::c(rounding(L::Real::EPSILON).powi(2)))
}

/// `h |lambda|` of the fastest rate that a motion excites, by its [`Watch::contrast`]: a single mode, real or oscillating,
/// makes `h` times the right-hand side's change so many times the states' own difference (on average over a period).
/// Noise of rounding, which passes for a very fast rate where nothing moves, does not count.
#[inline(always)]
pub fn stiffness<L: Lane>([places, speeds, changes]: [L; 3], epsilon: f64) -> L {
    ((speeds + changes) / (places + speeds + L::c(rounding(epsilon).powi(2) / (1.0 - KEPT)))).sqrt()
}

/// Share of its velocities that the steps of a motion got wrong of late, by [`Watch::slip`] and [`Watch::spin`]; a motion
/// slower than [`REST`] counts as one of that speed.
#[inline(always)]
pub fn step_error<L: Lane>([error, way, spin]: [L; 3], h: f64) -> L {
    (error / way.max(L::c(REST * h))).max(spin)
}

fn rounding(epsilon: f64) -> f64 {
    ROUNDING * epsilon
}

//! What the pieces of a motion show besides its state: how fast the rates are that it excites, and what they get wrong.

use super::motion::Motion;
use super::tableau::Tableau;
use crate::lane::{Lane, Real};
use crate::lie::Vector3;

/// Part of what was seen that a piece leaves behind: some thirty of them count.
const LEAK: f64 = 1.0 / 32.0;
/// Time that errors of spinning count for, s: no damping takes them away.
const SPIN_TIME: f64 = 10.0;
/// Turn within a piece from which on spinning counts, rad.
const SPIN: f64 = 0.02;
/// Rounding of differences within a step, by the unit round-off times two: they matter from here on, m and rad.
const ROUNDING: f64 = 100.0;

/// What was seen of a motion; all 0 at first.
#[derive(Debug, Clone, Copy)]
pub struct Watch<L> {
    /// Squares whose quotient is that of `h` times the fastest rate that the motion excites, averaged over some thirty
    /// pieces, the last ones counting most: of `h` times the right-hand side's change within a piece, and of the
    /// states' own difference, in m and rad.
    pub contrast: [L; 2],
    /// Errors of the velocities that these pieces made, estimated, as displacements over a piece; and the greatest
    /// displacement over a piece, both fading likewise. m and rad.
    pub slip: [L; 2],
    /// Share of the velocities that spinning has got wrong in the last ten seconds, estimated.
    pub spin: L,
    /// Piece that an adaptive method plans next, by the interval.
    pub plan: L,
}

impl<L: Lane> Watch<L> {
    /// Takes note of a piece of size `h` in the lanes that took it: its squared turn and its contrast, its start and end.
    #[inline(always)]
    pub(super) fn note<const N: usize>(
        &mut self,
        taken: L::Mask,
        tableau: &Tableau,
        h: L,
        (turn, contrast): (L, [L; 2]),
        (from, to): (&Motion<L, N>, &Motion<L, N>),
        n: usize,
    ) {
        let kept = L::c(1.0 - LEAK);
        for part in 0..2 {
            let sum = self.contrast[part].mul_add(kept, contrast[part]);
            self.contrast[part] = L::select(taken, sum, self.contrast[part]);
        }
        if tableau.error.is_some() {
            return;
        }
        let error = self.slip[0].mul_add(kept, slip(tableau, contrast));
        let way = (self.slip[1] * kept).max(to.way(h, n));
        self.slip = [L::select(taken, error, self.slip[0]), L::select(taken, way, self.slip[1])];
        let mut spin = (h * self.spin).neg_mul_add(L::c(1.0 / SPIN_TIME), self.spin);
        let spins = L::c(SPIN * SPIN).lt(turn);
        if L::any(spins) {
            spin += L::select(spins, spun(tableau, turn, from, to), L::zero());
        }
        self.spin = L::select(taken, spin, self.spin);
    }
}

/// Error of a piece on what changes fastest, by its contrast.
#[inline(always)]
fn slip<L: Lane>(tableau: &Tableau, [change, apart]: [L; 2]) -> L {
    let Some(contrast) = &tableau.contrast else { return L::zero() };
    let (factor, power) = contrast.slip;
    let square = change / (apart + L::c(rounding(L::Real::EPSILON).powi(2)));
    let rate = if power == 2 { square } else { square.sqrt() };
    change.sqrt() * rate * L::c(factor)
}

/// Error of a piece that turns by `theta`, as a share of the velocities: `u theta^p / (p + 1)!` for order p, where u is the
/// share that linear or angular velocity changes by in body axes. A steady spin has no error at all.
#[inline(always)]
fn spun<L: Lane, const N: usize>(tableau: &Tableau, turn: L, from: &Motion<L, N>, to: &Motion<L, N>) -> L {
    let power = match tableau.order {
        1 => turn.sqrt() * L::c(1.0 / 2.0),
        2 => turn * L::c(1.0 / 6.0),
        3 => turn * turn.sqrt() * L::c(1.0 / 24.0),
        _ => turn * turn * L::c(1.0 / 120.0),
    };
    let linear = changed(from.twist.linear, to.twist.linear);
    let angular = changed(from.twist.angular, to.twist.angular);
    power * linear.max(angular).min(L::c(1.0)).sqrt()
}

/// Square of the share of its length that a velocity changes by; a change within rounding is none.
#[inline(always)]
fn changed<L: Lane>(from: Vector3<L>, to: Vector3<L>) -> L {
    let change = to - from;
    change.dot(change) / (from.dot(from) + L::c(rounding(L::Real::EPSILON).powi(2)))
}

/// `h |lambda|` of the fastest rate that a motion excites, by its [`Watch::contrast`]. Noise of rounding, which passes for
/// a very fast rate where nothing moves, does not count.
pub fn stiffness([change, apart]: [f64; 2], epsilon: f64) -> f64 {
    (change / (apart + rounding(epsilon).powi(2) / LEAK)).sqrt()
}

/// Share of its velocities that the steps of a motion got wrong of late, by [`Watch::slip`] and [`Watch::spin`]; none of what
/// moves within rounding.
pub fn step_error([error, way, spin]: [f64; 3], epsilon: f64) -> f64 {
    (error / (way + rounding(epsilon))).max(spin)
}

fn rounding(epsilon: f64) -> f64 {
    ROUNDING * epsilon
}

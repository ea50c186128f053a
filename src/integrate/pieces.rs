//! Covering an interval by pieces: one where that will do, more for the lanes that need them.

use super::Derivative;
use super::catalogue::Explicit;
use super::explicit::{Stages, explicit};
use super::motion::Motion;
use crate::lane::Lane;

/// Rotation within a piece beyond which a lane's piece is halved. The maps hold up to pi, but the velocity of a spinning
/// body turns in body axes as fast, and grows where that is outside of a tableau's stability: 2.83 (RK4), 1.73 (Heun).
const GREATEST_TURN: f64 = std::f64::consts::FRAC_PI_2;
/// Smallest piece by the interval; a lane that needs a smaller one becomes NaN, never a wrong number.
const LEAST_SHARE: f64 = 1.0 / 1024.0;

/// Covers an interval of length `h`. Lanes that turn by more than a quarter revolution within a piece take it in halves,
/// quarters, and so on; lanes that have arrived stay as they are meanwhile.
#[inline(always)]
pub fn interval<L: Lane, D: Derivative<L, N>, const N: usize>(
    method: &Explicit,
    h: L::Real,
    motion: &mut Motion<L, N>,
    trial: &mut Motion<L, N>,
    derivative: &mut D,
    stages: &mut Stages<L, N>,
) {
    let n = derivative.joints();
    let (zero, half, one) = (L::zero(), L::c(0.5), L::c(1.0));
    let limit = L::c(GREATEST_TURN * GREATEST_TURN);
    let h = L::splat(h);
    // The piece at hand and what is left of the interval, as fractions of it.
    let (mut share, mut left) = (one, one);
    let mut begun = false;
    loop {
        let turn = explicit(method, h * share, h * (one - left), motion, trial, derivative, stages);
        // A turn that is NaN is not below the limit either: the maps overflow on far too great ones.
        let fine = L::select(turn.lt(limit), one, zero);
        let taken = L::select(zero.lt(left), fine, zero);
        motion.keep(half.lt(taken), trial, n);
        left = share.neg_mul_add(taken, left);
        if !L::any(zero.lt(left)) {
            return;
        }
        // Lanes that take no piece here have arrived, are lost, or need a smaller one; no piece mends what was lost before.
        let sound = if begun { one } else { motion.sound(n) };
        let lost = L::select(share.lt(L::c(1.5 * LEAST_SHARE)), one, one - sound) * (one - fine);
        let lost = L::select(zero.lt(left), lost, zero);
        motion.keep(half.lt(lost), &Motion::lost(), n);
        left = L::select(half.lt(lost), zero, left);
        share = L::select(half.lt(fine), share, share * half);
        begun = true;
        if !L::any(zero.lt(left)) {
            return;
        }
    }
}

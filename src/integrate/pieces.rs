//! Covering an interval by pieces: one where that will do, more for the lanes that need them.

use super::Derivative;
use super::catalogue::Explicit;
use super::explicit::{Report, arrive, explicit};
use super::motion::Motion;
use super::stages::Stages;
use super::watch::Watch;
use crate::lane::{Lane, Real};

/// Rotation within a piece beyond which a lane's piece is halved. The maps hold up to pi, but the velocity of a spinning
/// body turns in body axes as fast, and grows where that is outside of a tableau's stability: 2.83 (RK4), 1.73 (Heun).
const GREATEST_TURN: f64 = std::f64::consts::FRAC_PI_2;
/// Smallest piece by the interval; a lane that needs a smaller one becomes NaN, never a wrong number.
const LEAST_SHARE: f64 = 1.0 / 1024.0;
/// Most attempts at pieces of an adaptive method within an interval; likewise.
const MOST_ATTEMPTS: u32 = 1 << 14;
/// Greatest piece that an adaptive method plans, by the interval.
const GREATEST_PLAN: f64 = 4.0;

/// Covers an interval of length `h`. Adaptive methods choose the pieces by their estimated error. With the others lanes
/// that turn by more than a quarter revolution within a piece take it in halves, quarters, and so on. Lanes that have
/// arrived stay as they are meanwhile. Without `BASELINES` only for methods on the exponential map
/// ([`super::Integrator::needs_baseline_terms`] tells): the others' coordinates are then not compiled.
#[inline(always)]
pub fn interval<L: Lane, D: Derivative<L, N>, const N: usize, const BASELINES: bool>(
    method: &Explicit,
    h: L::Real,
    motion: &mut Motion<L, N>,
    watch: &mut Watch<L>,
    derivative: &mut D,
    stages: &mut Stages<L, N>,
) {
    let n = derivative.joints();
    let (zero, half, one) = (L::zero(), L::c(0.5), L::c(1.0));
    let adaptive = method.tableau.error.is_some();
    // No estimate is better than rounding.
    let tolerance = method.tolerance.max(8.0 * L::Real::EPSILON);
    let over_tolerance = L::c(1.0 / (tolerance * tolerance));
    let limit = L::c(GREATEST_TURN * GREATEST_TURN);
    let h = L::splat(h);
    // The piece that is planned and what is left of the interval, as shares of it.
    let (mut plan, mut left) = (one, one);
    if adaptive {
        plan = L::select(zero.lt(watch.plan), watch.plan, one);
    }
    let mut attempts = 0;
    loop {
        // The whole rest, or half of it rather than a piece and a sliver.
        let short = L::select(left.lt(plan + plan), left * half, plan);
        let share = L::select(plan.lt(left), short, left);
        let begun = adaptive && attempts > 0;
        let (Report { turn, error, contrast }, end) =
            explicit::<_, _, _, BASELINES>(method, (h * share, h * (one - left), begun), motion, derivative, stages);
        attempts += 1;
        // A turn or an error that is NaN is not below its limit either: the maps overflow on far too great ones.
        let fine = L::select(turn.lt(limit), one, zero);
        let error = error * over_tolerance;
        let fine = L::select(error.lt(one), fine, zero);
        let active = L::select(zero.lt(left), one, zero);
        let taken = half.lt(fine * active);
        let wrong = watch.compare(taken, method.tableau, contrast);
        if !adaptive {
            let to = (&end.twist, &stages.qd_at);
            watch.judge(taken, method.tableau.order, (h * share, wrong, turn), &motion.twist, to, n);
        }
        arrive::<_, _, BASELINES>(method.chart, taken, &end, stages, motion, n);
        left = L::select(taken, left - share, left);
        if adaptive {
            let factor = growth(error);
            let factor = L::select(half.lt(fine), factor, factor.min(half));
            let next = share * factor;
            let next = L::select(factor.lt(one), next, next.max(plan)).min(L::c(GREATEST_PLAN));
            plan = L::select(half.lt(active), next, plan);
        } else {
            plan = L::select(half.lt(fine), plan, plan * half);
        }
        if !L::any(zero.lt(left)) {
            break;
        }
        // Lanes that took no piece need a smaller one, or are lost: no piece mends what was lost before.
        let sound = if attempts == 1 { motion.sound(n) } else { one };
        let spent = if adaptive {
            L::c(if attempts == MOST_ATTEMPTS { 1.0 } else { 0.0 })
        } else {
            L::select(share.lt(L::c(1.5 * LEAST_SHARE)), one - fine, zero)
        };
        let lost = half.lt(active * spent.max(one - sound) * L::select(zero.lt(left), one, zero));
        motion.lose(lost, n);
        left = L::select(lost, zero, left);
        if adaptive {
            stages.carry(taken, n, motion);
        }
        if !L::any(zero.lt(left)) {
            break;
        }
    }
    if adaptive {
        watch.plan = plan;
    }
}

/// What the next piece is by this one: `0.9 error^(-1/5)`, within bounds. (By roots: of the square, `error^(-3/32)`.)
#[inline(always)]
fn growth<L: Lane>(squared_error: L) -> L {
    let eighth = squared_error.max(L::c(1e-12)).sqrt().sqrt().sqrt().sqrt();
    (L::c(0.9) / (eighth * eighth.sqrt())).max(L::c(0.1)).min(L::c(5.0))
}

//! Division of a step into sub-intervals: one where that is enough, more for the lanes that need them.

use std::hint::cold_path;

use super::Derivative;
use super::explicit::{Report, explicit, move_to_end};
use super::motion::Motion;
use super::recorder::Recorder;
use super::registry::{Explicit, MIN_TOLERANCE};
use super::stages::Stages;
use super::step_estimates::StepEstimates;
use super::tableau::STAGES;
use crate::lane::{Lane, Real};

/// Smallest sub-interval as a fraction of the interval; a lane that needs a smaller one becomes NaN, never a wrong number.
const MIN_SHARE: f64 = 1.0 / 1024.0;
/// Most halvings of an interval for contacts.
const MOST_HALVES: usize = 9;
/// Most attempts of an adaptive method within an interval; a lane that needs more becomes NaN.
const MOST_ATTEMPTS: u32 = 1 << 14;
/// Maximum sub-interval that an adaptive method plans, as a fraction of the interval.
const MAX_PLAN: f64 = 4.0;

/// Integrates over an interval of length `h`. Adaptive methods choose sub-intervals by their estimated error. With the other
/// methods lanes that turn by more than the method allows within a sub-interval divide it into halves, quarters, and so
/// on. Lanes that have reached the end of the interval keep their state meanwhile. Without `BASELINES` only for methods on the exponential map
/// ([`super::Integrator::needs_baseline_terms`] tells): the others' coordinates are then not compiled.
#[inline(always)]
pub fn interval<L: Lane, D: Derivative<L, N>, R: Recorder<L, N>, const N: usize, const BASELINES: bool>(
    method: &Explicit,
    h: L::Real,
    motion: &mut Motion<L, N>,
    estimates: &mut StepEstimates<L>,
    derivative: &mut D,
    stages: &mut Stages<L, N>,
    recorder: &mut R,
) {
    let n = derivative.joints();
    let (zero, half, one) = (L::zero(), L::c(0.5), L::c(1.0));
    let adaptive = method.tableau.error.is_some();
    let tolerance = method.tolerance.max(MIN_TOLERANCE * L::Real::EPSILON);
    let over_tolerance = L::c(1.0 / (tolerance * tolerance));
    let limit = L::c(method.max_turn * method.max_turn);
    let h = L::splat(h);
    // Planned sub-interval and rest of the interval, as fractions of it.
    let (mut plan, mut left) = (one, one);
    if adaptive {
        plan = L::select(zero.lt(estimates.planned), estimates.planned, one);
    }
    if let (Some(rate), false) = (derivative.contact_rate(motion, h), adaptive) {
        cold_path();
        plan = share_in_contact(rate, method.max_contact);
    }
    let mut attempts = 0;
    loop {
        // The whole rest, or half of it rather than the planned sub-interval and a sliver.
        let short = L::select(left.lt(plan + plan), left * half, plan);
        let share = L::select(plan.lt(left), short, left).constant();
        let begun = adaptive && attempts > 0;
        let (Report { turn, error, contrast }, end) =
            explicit::<_, _, _, BASELINES>(method, (h * share, h * (one - left), begun), motion, derivative, stages);
        attempts += 1;
        // Limits fail for NaN too: the maps overflow far beyond them.
        let accepted = L::select(turn.lt(limit), one, zero);
        let error = error * over_tolerance;
        let accepted = L::select(error.lt(one), accepted, zero);
        let active = L::select(zero.lt(left), one, zero);
        let taken = half.lt(accepted * active);
        let stage_error = estimates.record_contrast(taken, method.tableau, contrast);
        if !adaptive {
            let to = (&end.twist, &stages.qd_at);
            let sub_interval = (h * share, stage_error, turn);
            estimates.record_errors(taken, method.tableau.order, sub_interval, &motion.twist, to, n);
        }
        for i in 0..method.tableau.stages.min(STAGES) {
            recorder.rates(&stages.rates[i], n);
        }
        recorder.sub_interval(motion, n, [h * share, h * (one - left)], taken);
        move_to_end::<_, _, BASELINES>(method.chart, taken, &end, stages, motion, n);
        left = L::select(taken, left - share, left);
        if adaptive {
            let factor = growth(error);
            let factor = L::select(half.lt(accepted), factor, factor.min(half));
            let next = share * factor;
            let next = L::select(factor.lt(one), next, next.max(plan)).min(L::c(MAX_PLAN));
            plan = L::select(half.lt(active), next, plan);
        } else {
            plan = L::select(half.lt(accepted), plan, plan * half);
        }
        if !L::any(zero.lt(left)) {
            break;
        }
        // Lanes that did not advance need a smaller sub-interval, or are lost: nothing restores a state that is not finite.
        let finite = if attempts == 1 { motion.finite(n) } else { one };
        let spent = if adaptive {
            L::c(if attempts == MOST_ATTEMPTS { 1.0 } else { 0.0 })
        } else {
            L::select(share.lt(L::c(1.5 * MIN_SHARE)), one - accepted, zero)
        };
        let lost = half.lt(active * spent.max(one - finite) * L::select(zero.lt(left), one, zero));
        motion.set_nan_where(lost, n);
        left = L::select(lost, zero, left);
        if adaptive {
            stages.carry(taken, n, motion);
        }
        if !L::any(zero.lt(left)) {
            break;
        }
    }
    if adaptive {
        estimates.planned = plan;
    }
}

/// Share of an interval, a power of 1/2, in which a contact of this rate times the interval's length has at most `limit` of it.
#[inline(always)]
pub(super) fn share_in_contact<L: Lane>(rate: L, limit: f64) -> L {
    let (mut share, limit) = (L::c(1.0), L::c(limit));
    for _ in 0..MOST_HALVES {
        let beyond = limit.lt(rate * share);
        if !L::any(beyond) {
            break;
        }
        share = L::select(beyond, share * L::c(0.5), share);
    }
    share
}

/// Ratio of the next sub-interval to this one: `0.9 error^(-1/5)`, within bounds. (By roots: of the square, `error^(-3/32)`.)
#[inline(always)]
fn growth<L: Lane>(squared_error: L) -> L {
    let eighth = squared_error.max(L::c(1e-12)).sqrt().sqrt().sqrt().sqrt();
    (L::c(0.9) / (eighth * eighth.sqrt())).max(L::c(0.1)).min(L::c(5.0))
}

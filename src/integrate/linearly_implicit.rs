//! Linearly implicit methods of order 2 and 3: linearly implicit Euler, extrapolated. `[HW96 sec. IV.9]`
//!
//! One step of the linearly implicit Euler rule `(I - h J) k = f`, `y + h k`, over the whole step, in two halves and, for order
//! 3, in three thirds, in the coordinates `(Theta, q; V, q')` about the step's start. The end of a step in j parts differs from the
//! exact one by a series in 1/j, whatever J is: the sum of the first K ends with the weights `w_j = prod_(i != j) j / (j - i)`,
//! (-1, 2) or (1/2, -4, 9/2), is of order K (Aitken and Neville). Each solve has its own J, of the point it starts from.
//!
//! (The method of `[VSBH99]`, ROS2, needs one solve less than order 2 here, but overshoots within the step where forces saturate or
//! grow.)
//!
//! The stability functions `sum_j w_j (1 - z/j)^-j` vanish at infinity (L-stable). Order 2 is A-stable; order 3
//! amplifies some undamped oscillations by up to 0.16 % a step. With a J that overestimates the true rate by a factor 1/p they become
//! `sum_j w_j (1 - p)^j` there: stable for `0 < p <= 3/2` in order 2, up to 1.36 in order 3.

use std::hint::cold_path;

use super::chart::Increment;
use super::motion::Motion;
use super::recorder::Recorder;
use super::registry::Implicit;
use super::step_estimates::StepEstimates;
use super::sub_intervals::share_in_contact;
use super::{Derivative, Rates};
use crate::lane::{Lane, unroll};
use crate::lie::{DexpInverse, Vector6, dexp_inverse_negative, rotate_back};

/// Weights of the ends of a step in 1, 2, ... parts.
pub(super) fn extrapolation_weights(order: usize) -> &'static [f64] {
    if order == 2 { &[-1.0, 2.0] } else { &[0.5, -4.0, 4.5] }
}

/// Right-hand side of a linearly implicit method.
pub trait LinearlyImplicit<L: Lane, const N: usize>: Derivative<L, N> {
    /// Rates k of `(I - h J) k = f` at a point, with f as at the end of a step from there; `when` is where that step
    /// begins after the start of the interval, and its size h.
    fn implicit_rates(
        &mut self,
        at: &impl super::StagePose<L>,
        when: (L, L),
        twist: Vector6<L>,
        q: &[L; N],
        qd: &[L; N],
        rates: &mut Rates<L, N>,
    );

    /// Maximum joint rate that a step of size `h` lost or gained at an end stop which would have returned another, of stops whose
    /// `h |rate|` is beyond `range`; from joints and rates at the start and at the end, after the solves.
    fn lost_bounce(&self, h: L, range: f64, ends: [(&[L; N], &[L; N]); 2]) -> L;
}

/// Smallest sub-interval as a fraction of the interval; a lane that needs a smaller one becomes NaN, never a wrong number.
const MIN_SHARE: f64 = 1.0 / 1024.0;

/// Joint rate that a bounce may lose or gain, rad/s or m/s.
const MIN_BOUNCE: f64 = 1e-3;

/// Coordinates of a point within a step.
#[derive(Debug, Clone)]
pub(super) struct Point<L, const N: usize> {
    pub theta: Vector6<L>,
    pub twist: Vector6<L>,
    pub q: [L; N],
    pub qd: [L; N],
}

impl<L: Lane, const N: usize> Point<L, N> {
    pub(super) fn blank() -> Self {
        let zero = [L::zero(); N];
        Self { theta: Vector6::zero(), twist: Vector6::zero(), q: zero, qd: zero }
    }

    /// Moves to the start. (Entry by entry: whole arrays would be copied by a call.)
    #[inline(always)]
    pub(super) fn start(&mut self, from: &Motion<L, N>, n: usize) {
        self.theta = Vector6::zero();
        self.twist = from.twist;
        for k in 0..n {
            self.q[k] = from.q[k];
            self.qd[k] = from.qd[k];
        }
    }

    /// Euler's rule, each coordinate at the rate of its end; the velocity v in axes that do not turn, so that a spinning body in
    /// straight motion neither gains nor loses speed.
    #[inline(always)]
    pub(super) fn advance(&mut self, h: L, rates: &Rates<L, N>, n: usize) {
        let Vector6 { linear: v, angular: omega } = self.twist;
        let angular = rates.twist.angular.scale_add(h, omega);
        let straight = omega.cross_add(v, rates.twist.linear).scale_add(h, v);
        self.twist = Vector6 { linear: rotate_back(angular.scale(h), straight), angular };
        self.theta = dexp_inverse_negative(DexpInverse::Truncated, self.theta, self.twist).scale_add(h, self.theta);
        for k in 0..n {
            self.qd[k] = rates.qd[k].mul_add(h, self.qd[k]);
            self.q[k] = self.qd[k].mul_add(h, self.q[k]);
        }
    }

    /// Twice this less the other.
    #[inline(always)]
    fn extrapolate(&mut self, coarse: &Self, n: usize) {
        let two = L::c(2.0);
        let minus = L::c(-1.0);
        self.theta = self.theta.scale_add(two, coarse.theta.scale(minus));
        self.twist = self.twist.scale_add(two, coarse.twist.scale(minus));
        for k in 0..n {
            self.q[k] = self.q[k].mul_add(two, -coarse.q[k]);
            self.qd[k] = self.qd[k].mul_add(two, -coarse.qd[k]);
        }
    }

    /// `1/2` of one less 4 times another plus `9/2` of this; before that, the distance of its velocities from the result without the
    /// first, `3` of this less `2` of the other.
    #[inline(always)]
    fn extrapolate_twice(&mut self, coarse: &Self, middle: &Self, n: usize) -> L {
        let (a, b, c) = (L::c(0.5), L::c(-4.0), L::c(4.5));
        let mut square = L::zero();
        unroll!(k in 0 1 2 => {
            let line = spread(coarse.twist.linear.0[k], middle.twist.linear.0[k], self.twist.linear.0[k]);
            let turn = spread(coarse.twist.angular.0[k], middle.twist.angular.0[k], self.twist.angular.0[k]);
            square = line.mul_add(line, turn.mul_add(turn, square));
        });
        self.theta = self.theta.scale_add(c, middle.theta.scale_add(b, coarse.theta.scale(a)));
        self.twist = self.twist.scale_add(c, middle.twist.scale_add(b, coarse.twist.scale(a)));
        for k in 0..n {
            let more = spread(coarse.qd[k], middle.qd[k], self.qd[k]);
            square = more.mul_add(more, square);
            self.q[k] = self.q[k].mul_add(c, middle.q[k].mul_add(b, coarse.q[k] * a));
            self.qd[k] = self.qd[k].mul_add(c, middle.qd[k].mul_add(b, coarse.qd[k] * a));
        }
        square.sqrt()
    }

    /// Copies another. (Entry by entry: whole arrays would be copied by a call.)
    #[inline(always)]
    pub(super) fn copy(&mut self, other: &Self, n: usize) {
        (self.theta, self.twist) = (other.theta, other.twist);
        for k in 0..n {
            (self.q[k], self.qd[k]) = (other.q[k], other.qd[k]);
        }
    }

    /// Distance of its velocities from others.
    #[inline(always)]
    fn velocity_distance(&self, twist: &Vector6<L>, qd: &[L; N], n: usize) -> L {
        let more = twist.scale_add(L::c(-1.0), self.twist);
        let mut sum = more.dot(more);
        for k in 0..n {
            let more = self.qd[k] - qd[k];
            sum = more.mul_add(more, sum);
        }
        sum.sqrt()
    }

    #[inline(always)]
    fn turn(&self) -> L {
        self.theta.angular.dot(self.theta.angular)
    }
}

/// Difference of the results of order 3 and 2, from the results of one, two and three parts.
#[inline(always)]
fn spread<L: Lane>(one: L, two: L, three: L) -> L {
    three.mul_add(L::c(1.5), two.mul_add(L::c(-2.0), one * L::c(0.5)))
}

/// Memory of the linearly implicit methods: ends of a step by one part, by two if not the last, and by all, and the rates.
#[derive(Debug, Clone)]
pub struct ImplicitStages<L, const N: usize> {
    coarse: Point<L, N>,
    middle: Point<L, N>,
    fine: Point<L, N>,
    rates: Rates<L, N>,
}

impl<L: Lane, const N: usize> ImplicitStages<L, N> {
    /// Zeroed memory.
    pub fn blank() -> Self {
        Self { coarse: Point::blank(), middle: Point::blank(), fine: Point::blank(), rates: Rates::zero() }
    }
}

/// One step of size `h`, which begins `elapsed` after the start of the interval; leaves its end in `stages.fine`. Returns the
/// square of the maximum rotation within the step and the estimated error, m and rad.
#[inline(always)]
fn extrapolated<L: Lane, D: LinearlyImplicit<L, N>, R: Recorder<L, N>, const N: usize>(
    order: usize,
    (h, elapsed): (L, L),
    from: &Motion<L, N>,
    stages: &mut ImplicitStages<L, N>,
    derivative: &mut D,
    recorder: &mut R,
) -> (L, L) {
    let n = derivative.joints();
    let ImplicitStages { coarse, middle, fine, rates } = stages;
    fine.start(from, n);
    coarse.start(from, n);
    let mut maximum = L::zero();
    // One call of the right-hand side for all solves: it is by far the most code.
    let solves = if order == 2 { 3 } else { 6 };
    for solve in 0..solves {
        let (parts, part) = match solve {
            0 => (1.0, 0.0),
            1 => (0.5, 0.0),
            2 => (0.5, 1.0),
            _ => (1.0 / 3.0, (solve - 3) as f64),
        };
        if solve == 3 {
            middle.copy(fine, n);
            fine.start(from, n);
        }
        let size = h * L::c(parts);
        let point = if solve == 0 { &mut *coarse } else { &mut *fine };
        let at = Increment { start: &from.pose, theta: Some(point.theta) };
        let begin = elapsed + size * L::c(part);
        derivative.implicit_rates(&at, (begin, size), point.twist, &point.q, &point.qd, rates);
        recorder.rates(rates, n);
        point.advance(size, rates, n);
        maximum = maximum.max(point.turn());
    }
    // For a mode: distance of the first two ends z^2 / 4, change z; the error is the distance from the result of one order less times
    // 2/3 z, or 3/4 z.
    let (difference, distance, share) = if order == 2 {
        let difference = fine.velocity_distance(&coarse.twist, &coarse.qd, n) * h;
        fine.extrapolate(coarse, n);
        (difference, difference, 2.0 / 3.0)
    } else {
        let difference = middle.velocity_distance(&coarse.twist, &coarse.qd, n) * h;
        (difference, fine.extrapolate_twice(coarse, middle, n) * h, 3.0 / 4.0)
    };
    let changed = fine.velocity_distance(&from.twist, &from.qd, n) * h + L::c(1e-30);
    let error = distance * L::c(share) * (difference * L::c(4.0) / changed).min(L::c(1.0));
    (maximum.max(fine.turn()), error)
}

/// Integrates over an interval of length `h`. Lanes that turn by more than the method allows within a sub-interval, or lose a bounce that
/// is to be resolved, divide it into halves, quarters, and so on; lanes that have reached the end of the interval keep their state
/// meanwhile.
#[inline(always)]
pub fn implicit_interval<L: Lane, D: LinearlyImplicit<L, N>, R: Recorder<L, N>, const N: usize>(
    method: &Implicit,
    h: L::Real,
    motion: &mut Motion<L, N>,
    estimates: &mut StepEstimates<L>,
    derivative: &mut D,
    stages: &mut ImplicitStages<L, N>,
    recorder: &mut R,
) {
    let Implicit { order, max_turn, max_contact, bounce } = *method;
    let n = derivative.joints();
    let (zero, half, one) = (L::zero(), L::c(0.5), L::c(1.0));
    let limit = L::c(max_turn * max_turn);
    let h = L::splat(h);
    let (mut share, mut left) = (one, one);
    if let Some(rate) = derivative.contact_rate(motion, h) {
        cold_path();
        share = share_in_contact(rate, max_contact);
    }
    let mut begun = false;
    loop {
        let when = (h * share, h * (one - left));
        let (turn, error) = extrapolated(order, when, motion, stages, derivative, recorder);
        let end = &stages.fine;
        let mut accepted = L::select(turn.lt(limit), one, zero);
        if let Some(range) = bounce {
            cold_path();
            let ends = [(&motion.q, &motion.qd), (&end.q, &end.qd)];
            accepted = L::select(derivative.lost_bounce(h * share, range, ends).lt(L::c(MIN_BOUNCE)), accepted, zero);
        }
        let taken = L::select(zero.lt(left), accepted, zero);
        let takes = half.lt(taken);
        estimates.record_errors(takes, order, (h * share, error, turn), &motion.twist, (&end.twist, &end.qd), n);
        recorder.sub_interval(motion, n, when.into(), takes);
        motion.move_by(takes, end.theta, end.twist, (&end.q, &end.qd), n);
        left = share.neg_mul_add(taken, left);
        if !L::any(zero.lt(left)) {
            return;
        }
        let finite = if begun { one } else { motion.finite(n) };
        let lost = L::select(share.lt(L::c(1.5 * MIN_SHARE)), one, one - finite) * (one - accepted);
        let lost = L::select(zero.lt(left), lost, zero);
        motion.set_nan_where(half.lt(lost), n);
        left = L::select(half.lt(lost), zero, left);
        share = L::select(half.lt(accepted), share, share * half);
        begun = true;
        if !L::any(zero.lt(left)) {
            return;
        }
    }
}

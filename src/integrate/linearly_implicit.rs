//! A linearly implicit method of order 2: linearly implicit Euler, extrapolated. `[HW96 sec. IV.9]`
//!
//! One step of the linearly implicit Euler rule `(I - h J) k = f`, `y + h k`, once over the whole step and once in two
//! halves, in the coordinates `(Theta, q; V, q')` about the step's start; twice the fine result less the coarse one is of
//! order 2, for any J at all. Each of the three solves has its own J, of the point it starts from.
//!
//! (The method of `[VSBH99]`, ROS2, needs one solve less, but overshoots within the step where forces saturate or grow.)
//!
//! Its stability function `2 / (1 - z/2)^2 - 1 / (1 - z)` is A-stable and vanishes at infinity (L-stable). With a J that
//! overestimates the true rate by a factor 1/p it becomes `(1 - p)(1 - 2 p)` there: stable for `0 < p <= 3/2`.

use super::chart::Increment;
use super::motion::Motion;
use super::step_estimates::StepEstimates;
use super::{Derivative, Rates};
use crate::lane::Lane;
use crate::lie::{DexpInverse, Vector6, dexp_inverse_negative, rotate_back};

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
}

/// Rotation within a step beyond which a lane halves it. Smaller than the explicit methods': Euler's equations and other
/// products of velocities are treated explicitly, and an oscillation then grows by `(h rate)^4 / 8` a step.
const GREATEST_TURN: f64 = 0.5;
/// Smallest sub-interval as a fraction of the interval; a lane that needs a smaller one becomes NaN, never a wrong number.
const LEAST_SHARE: f64 = 1.0 / 1024.0;

/// Coordinates of a point within a step.
#[derive(Debug, Clone)]
struct Point<L, const N: usize> {
    theta: Vector6<L>,
    twist: Vector6<L>,
    q: [L; N],
    qd: [L; N],
}

impl<L: Lane, const N: usize> Point<L, N> {
    fn new() -> Self {
        let zero = [L::zero(); N];
        Self { theta: Vector6::zero(), twist: Vector6::zero(), q: zero, qd: zero }
    }

    /// Moves to the start. (Entry by entry: whole arrays would be copied by a call.)
    #[inline(always)]
    fn start(&mut self, from: &Motion<L, N>, n: usize) {
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
    fn advance(&mut self, h: L, rates: &Rates<L, N>, n: usize) {
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

/// Memory of the linearly implicit method: end of a step by two halves and by one, and the rates.
#[derive(Debug, Clone)]
pub struct ImplicitStages<L, const N: usize> {
    fine: Point<L, N>,
    coarse: Point<L, N>,
    rates: Rates<L, N>,
}

impl<L: Lane, const N: usize> ImplicitStages<L, N> {
    /// Zeroed memory.
    pub fn new() -> Self {
        let rates = Rates { twist: Vector6::zero(), qd: [L::zero(); N] };
        Self { fine: Point::new(), coarse: Point::new(), rates }
    }
}

impl<L: Lane, const N: usize> Default for ImplicitStages<L, N> {
    fn default() -> Self {
        Self::new()
    }
}

/// One step of size `h`, which begins `elapsed` after the start of the interval; leaves its end in `stages.fine`. Returns the
/// square of the greatest rotation within the step and the estimated error, m and rad.
#[inline(always)]
fn extrapolated<L: Lane, D: LinearlyImplicit<L, N>, const N: usize>(
    h: L,
    elapsed: L,
    from: &Motion<L, N>,
    stages: &mut ImplicitStages<L, N>,
    derivative: &mut D,
) -> (L, L) {
    let n = derivative.joints();
    let half = h * L::c(0.5);
    let ImplicitStages { fine, coarse, rates } = stages;
    fine.start(from, n);
    coarse.start(from, n);
    let mut greatest = L::zero();
    // One call of the right-hand side for all three: it is by far the most code.
    for solve in 0..3 {
        let (begin, size) = match solve {
            0 => (elapsed, h),
            1 => (elapsed, half),
            _ => (elapsed + half, half),
        };
        let point = if solve == 0 { &mut *coarse } else { &mut *fine };
        let at = Increment { start: &from.pose, theta: Some(point.theta) };
        derivative.implicit_rates(&at, (begin, size), point.twist, &point.q, &point.qd, rates);
        point.advance(size, rates, n);
        greatest = greatest.max(point.turn());
    }
    let apart = fine.velocity_distance(&coarse.twist, &coarse.qd, n) * h;
    fine.extrapolate(coarse, n);
    // For a mode: distance z^2 / 4, change z, error z^3 / 6.
    let changed = fine.velocity_distance(&from.twist, &from.qd, n) * h + L::c(1e-30);
    let error = apart * L::c(2.0 / 3.0) * (apart * L::c(4.0) / changed).min(L::c(1.0));
    (greatest.max(fine.turn()), error)
}

/// Integrates over an interval of length `h`. Lanes that turn by more than half a radian within a sub-interval divide it into
/// halves, quarters, and so on; lanes that have reached the end of the interval keep their state meanwhile.
#[inline(always)]
pub fn implicit_interval<L: Lane, D: LinearlyImplicit<L, N>, const N: usize>(
    h: L::Real,
    motion: &mut Motion<L, N>,
    estimates: &mut StepEstimates<L>,
    derivative: &mut D,
    stages: &mut ImplicitStages<L, N>,
) {
    let n = derivative.joints();
    let (zero, half, one) = (L::zero(), L::c(0.5), L::c(1.0));
    let limit = L::c(GREATEST_TURN * GREATEST_TURN);
    let h = L::splat(h);
    let (mut share, mut left) = (one, one);
    let mut begun = false;
    loop {
        let (turn, error) = extrapolated(h * share, h * (one - left), motion, stages, derivative);
        let end = &stages.fine;
        let fine = L::select(turn.lt(limit), one, zero);
        let taken = L::select(zero.lt(left), fine, zero);
        let takes = half.lt(taken);
        estimates.record_errors(takes, 2, (h * share, error, turn), &motion.twist, (&end.twist, &end.qd), n);
        motion.move_by(takes, end.theta, end.twist, (&end.q, &end.qd), n);
        left = share.neg_mul_add(taken, left);
        if !L::any(zero.lt(left)) {
            return;
        }
        let finite = if begun { one } else { motion.finite(n) };
        let lost = L::select(share.lt(L::c(1.5 * LEAST_SHARE)), one, one - finite) * (one - fine);
        let lost = L::select(zero.lt(left), lost, zero);
        motion.set_nan_where(half.lt(lost), n);
        left = L::select(half.lt(lost), zero, left);
        share = L::select(half.lt(fine), share, share * half);
        begun = true;
        if !L::any(zero.lt(left)) {
            return;
        }
    }
}

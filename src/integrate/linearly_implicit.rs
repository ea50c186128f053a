//! Linearly implicit methods of order 2 to 4: linearly implicit Euler, extrapolated. `[HW96 sec. IV.9]`
//!
//! One step of the linearly implicit Euler rule `(I - h J) k = f`, `y + h k`, over the whole step, in two halves, in three
//! thirds and so on, in the coordinates `(Theta, q; V, q')` about the step's start. The end of a step in j parts differs from the exact
//! one by a series in 1/j, whatever J is, so that the sum of the first K ends with weights `prod_(i != j) j / (j - i)` is of order
//! K (Aitken and Neville). Each of the `K (K + 1) / 2` solves has its own J, of the point it starts from.
//!
//! (The method of `[VSBH99]`, ROS2, needs one solve less than the order 2 here, but overshoots within the step where forces saturate
//! or grow.)
//!
//! The stability functions `sum_j w_j (1 - z/j)^-j` vanish at infinity (L-stable). That of order 2 is A-stable; those of order 3 and 4
//! amplify some undamped oscillations by up to 0.16 and 0.48 % a step. With a J that overestimates the true rate by a factor 1/p they
//! become `sum_j w_j (1 - p)^j` there: stable for `0 < p <= 3/2` in order 2, up to 1.36 in order 3 and 1.32 in order 4.

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

    /// Sets it to `weight` times the other.
    #[inline(always)]
    fn scaled(&mut self, weight: L, of: &Self, n: usize) {
        self.theta = of.theta.scale(weight);
        self.twist = of.twist.scale(weight);
        for k in 0..n {
            self.q[k] = of.q[k] * weight;
            self.qd[k] = of.qd[k] * weight;
        }
    }

    /// Adds `weight` times the other.
    #[inline(always)]
    fn add_scaled(&mut self, weight: L, other: &Self, n: usize) {
        self.theta = other.theta.scale_add(weight, self.theta);
        self.twist = other.twist.scale_add(weight, self.twist);
        for k in 0..n {
            self.q[k] = other.q[k].mul_add(weight, self.q[k]);
            self.qd[k] = other.qd[k].mul_add(weight, self.qd[k]);
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

/// Memory of the linearly implicit methods.
#[derive(Debug, Clone)]
pub struct ImplicitStages<L, const N: usize> {
    /// Point within the step.
    point: Point<L, N>,
    /// End of the step by one part.
    coarse: Point<L, N>,
    /// Extrapolated end of the step, and that without the coarsest result, which is of one order less.
    end: Point<L, N>,
    lower: Point<L, N>,
    rates: Rates<L, N>,
}

/// Weights of the ends of a step in 1, 2, ... parts, by order; and those without the first.
const WEIGHTS: [[[f64; GREATEST_ORDER]; 2]; GREATEST_ORDER - 1] = [
    [[-1.0, 2.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
    [[0.5, -4.0, 4.5, 0.0], [0.0, -2.0, 3.0, 0.0]],
    [[-1.0 / 6.0, 4.0, -13.5, 32.0 / 3.0], [0.0, 2.0, -9.0, 8.0]],
];

/// Weights of the ends of a step in 1, 2, ... parts.
pub(super) fn extrapolation_weights(order: usize) -> impl Iterator<Item = f64> {
    WEIGHTS[order - 2][0].into_iter().take(order)
}

/// Greatest order.
const GREATEST_ORDER: usize = 4;

impl<L: Lane, const N: usize> ImplicitStages<L, N> {
    /// Zeroed memory.
    pub fn new() -> Self {
        let rates = Rates { twist: Vector6::zero(), qd: [L::zero(); N] };
        let point = Point::new;
        Self { point: point(), coarse: point(), end: point(), lower: point(), rates }
    }
}

impl<L: Lane, const N: usize> Default for ImplicitStages<L, N> {
    fn default() -> Self {
        Self::new()
    }
}

/// One step of size `h`, which begins `elapsed` after the start of the interval; leaves its end in `stages.end`. Returns the
/// square of the greatest rotation within the step and the estimated error, m and rad.
#[inline(always)]
fn extrapolated<L: Lane, D: LinearlyImplicit<L, N>, const N: usize>(
    order: usize,
    h: L,
    elapsed: L,
    from: &Motion<L, N>,
    stages: &mut ImplicitStages<L, N>,
    derivative: &mut D,
) -> (L, L) {
    let n = derivative.joints();
    let ImplicitStages { point, coarse, end, lower, rates } = stages;
    let order = order.clamp(2, GREATEST_ORDER);
    let [weights, lower_weights] = &WEIGHTS[order - 2];
    let (mut greatest, mut apart) = (L::zero(), L::zero());
    let (mut parts, mut part) = (1, 0);
    point.start(from, n);
    // One call of the right-hand side for all solves: it is by far the most code.
    loop {
        let size = h * L::c(1.0 / parts as f64);
        let at = Increment { start: &from.pose, theta: Some(point.theta) };
        let begin = elapsed + size * L::c(part as f64);
        derivative.implicit_rates(&at, (begin, size), point.twist, &point.q, &point.qd, rates);
        point.advance(size, rates, n);
        greatest = greatest.max(point.turn());
        part += 1;
        if part == parts {
            let weight = L::c(weights[parts - 1]);
            if parts == 1 {
                coarse.scaled(L::c(1.0), point, n);
                end.scaled(weight, point, n);
            } else {
                end.add_scaled(weight, point, n);
                let weight = L::c(lower_weights[parts - 1]);
                if parts == 2 {
                    apart = point.velocity_distance(&coarse.twist, &coarse.qd, n) * h;
                    lower.scaled(weight, point, n);
                } else {
                    lower.add_scaled(weight, point, n);
                }
            }
            if parts == order {
                break;
            }
            (parts, part) = (parts + 1, 0);
            point.start(from, n);
        }
    }
    // For a mode and order K: change z, distance of the first two results z^2 / 4, and of both extrapolated ones (K + 1) / K times the
    // error over z.
    let changed = end.velocity_distance(&from.twist, &from.qd, n) * h + L::c(1e-30);
    let rate = (apart * L::c(4.0) / changed).min(L::c(1.0));
    let distance = end.velocity_distance(&lower.twist, &lower.qd, n) * h;
    let error = distance * L::c(order as f64 / (order as f64 + 1.0)) * rate;
    (greatest.max(end.turn()), error)
}

/// Integrates over an interval of length `h`. Lanes that turn by more than half a radian within a sub-interval divide it into
/// halves, quarters, and so on; lanes that have reached the end of the interval keep their state meanwhile.
#[inline(always)]
pub fn implicit_interval<L: Lane, D: LinearlyImplicit<L, N>, const N: usize>(
    order: usize,
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
        let (turn, error) = extrapolated(order, h * share, h * (one - left), motion, stages, derivative);
        let end = &stages.end;
        let fine = L::select(turn.lt(limit), one, zero);
        let taken = L::select(zero.lt(left), fine, zero);
        let takes = half.lt(taken);
        estimates.record_errors(takes, order, (h * share, error, turn), &motion.twist, (&end.twist, &end.qd), n);
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

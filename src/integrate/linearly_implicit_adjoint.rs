//! Adjoint of a sub-interval of a linearly implicit method: reverse differentiation of its solves.

use super::Rates;
use super::linearly_implicit::{Point, extrapolation_weights};
use super::motion::Motion;
use super::motion_adjoint::{
    DerivativeAdjoint, MethodAdjoint, MotionCotangents, PoseCotangents, StageCotangents, StagePoint,
};
use super::recorder::SubInterval;
use super::registry::Implicit;
use crate::lane::{Lane, Tape};
use crate::lie::{DexpInverse, Vector3, Vector6, dexp_inverse_adjoint, rotate_back_adjoint};

/// Solves of a step: of one, two and three parts.
const SOLVES: usize = 6;

/// Memory of the adjoint: rates of the solves, and the points of one division of the step.
#[derive(Debug, Clone)]
pub struct ImplicitAdjoint<L, const N: usize> {
    rates: [Rates<L, N>; SOLVES],
    points: [Point<L, N>; 4],
    of_point: Point<L, N>,
    of_end: Point<L, N>,
    of_rates: Rates<L, N>,
    of_stage: StageCotangents<L, N>,
    part: SubInterval<L, N>,
    of_start: MotionCotangents<L, N>,
}

impl<L: Lane, const N: usize> ImplicitAdjoint<L, N> {
    /// Zeroed memory.
    pub fn blank() -> Self {
        Self {
            rates: [Rates::zero(); SOLVES],
            points: std::array::from_fn(|_| Point::blank()),
            of_point: Point::blank(),
            of_end: Point::blank(),
            of_rates: Rates::zero(),
            of_stage: StageCotangents::blank(),
            part: SubInterval::blank(),
            of_start: MotionCotangents::zero(),
        }
    }
}

impl<L: Lane, const N: usize> MethodAdjoint<L, N> for ImplicitAdjoint<L, N> {
    type Method = Implicit;

    #[inline(always)]
    fn start(&self) -> &Motion<L, N> {
        &self.part.from
    }

    #[inline(always)]
    fn reverse<D: DerivativeAdjoint<L, N>>(
        &mut self,
        method: &Implicit,
        tape: &mut Tape<L::Real>,
        derivative: &mut D,
        of: &mut MotionCotangents<L, N>,
    ) {
        let n = derivative.joints();
        let Self { rates, points, of_point, of_end, of_rates, of_stage, part, of_start } = self;
        let weights = extrapolation_weights(method.order);
        let divisions = weights.len().min(3);
        let first = |parts: usize| parts * (parts - 1) / 2;
        let takes = part.pop(tape, &mut rates[..first(divisions + 1)], of, n);
        let SubInterval { from, h, elapsed, of_end: of_last, .. } = &*part;

        // Theta of the end: the ends of all divisions.
        let mut theta = Vector6::zero();
        for parts in 1..=divisions {
            points[0].start(from, n);
            let size = *h * L::c(1.0 / parts as f64);
            for k in 0..parts {
                points[0].advance(size, &rates[first(parts) + k], n);
            }
            theta = points[0].theta.scale_add(L::c(weights[parts - 1]), theta);
        }
        of_start.clear(n);
        let of_pose = PoseCotangents { position: Some(of_last.position), turn: of_last.turn };
        of_end.theta = of_pose.pull_back(theta, &from.pose, of_start);
        of_end.twist = of_last.twist;
        for k in 0..n {
            (of_end.q[k], of_end.qd[k]) = (of_last.q[k], of_last.qd[k]);
        }
        for parts in 1..=divisions {
            let (size, weight) = (*h * L::c(1.0 / parts as f64), L::c(weights[parts - 1]));
            points[0].start(from, n);
            for k in 0..parts {
                let (before, after) = points.split_at_mut(k + 1);
                if let (Some(before), Some(after)) = (before.last(), after.first_mut()) {
                    after.copy(before, n);
                    after.advance(size, &rates[first(parts) + k], n);
                }
            }
            of_point.theta = of_end.theta.scale(weight);
            of_point.twist = of_end.twist.scale(weight);
            for k in 0..n {
                (of_point.q[k], of_point.qd[k]) = (of_end.q[k] * weight, of_end.qd[k] * weight);
            }
            for k in (0..parts).rev() {
                let (point, rates) = (&points[k], &rates[first(parts) + k]);
                of_point.advance_adjoint(size, rates, point, &points[k + 1], of_rates, n);
                let Point { theta, twist, q, qd } = point;
                let at = StagePoint { start: &from.pose, theta: *theta, twist: *twist, q, qd };
                let begin = size.mul_add(L::c(k as f64), *elapsed);
                derivative.rates_adjoint(&at, (begin, Some(size)), rates, of_rates, of_stage);
                let of_theta = of_stage.pose.pull_back(*theta, &from.pose, of_start);
                of_point.theta = of_point.theta + of_theta;
                of_point.twist = of_point.twist + of_stage.twist;
                for k in 0..n {
                    of_point.q[k] += of_stage.q[k];
                    of_point.qd[k] += of_stage.qd[k];
                }
            }
            // Theta is 0 at the start.
            of_start.twist = of_start.twist + of_point.twist;
            for k in 0..n {
                of_start.q[k] += of_point.q[k];
                of_start.qd[k] += of_point.qd[k];
            }
        }
        of.set_where(takes, of_start, n);
    }
}

impl<L: Lane, const N: usize> Point<L, N> {
    /// Reverse of [`Point::advance`]: replaces the cotangents of the advanced point by the cotangents of the
    /// point, and sets the cotangents of the rates.
    #[inline(always)]
    fn advance_adjoint(
        &mut self,
        h: L,
        rates: &Rates<L, N>,
        before: &Self,
        after: &Self,
        of_rates: &mut Rates<L, N>,
        n: usize,
    ) {
        let Vector6 { linear: v, angular: omega } = before.twist;
        let form = DexpInverse::Truncated;
        let (of_theta, of_twist) = dexp_inverse_adjoint(form, before.theta, after.twist, self.theta.scale(h));
        self.theta = self.theta + of_theta;
        let of_twist = self.twist + of_twist;
        let straight = omega.cross_add(v, rates.twist.linear).scale_add(h, v);
        let (of_turn, of_straight) = rotate_back_adjoint(after.twist.angular.scale(h), straight, of_twist.linear);
        let of_angular: Vector3<L> = of_turn.scale_add(h, of_twist.angular);
        let of_change = of_straight.scale(h);
        of_rates.twist = Vector6 { linear: of_change, angular: of_angular.scale(h) };
        self.twist =
            Vector6 { linear: of_change.cross_add(omega, of_straight), angular: v.cross_add(of_change, of_angular) };
        for k in 0..n {
            self.qd[k] = self.q[k].mul_add(h, self.qd[k]);
            of_rates.qd[k] = self.qd[k] * h;
        }
    }
}

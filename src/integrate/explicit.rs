//! One driver for all explicit Runge-Kutta methods. `[HC eq. 14, 17-18]`, `[PC05]`
//!
//! A stage's coordinates are the start's plus `h sum a_ij k_j`; what they are and how they change is the chart's. The
//! one call of the right-hand side below is what all methods share: it is by far the most code.

use super::catalogue::Explicit;
use super::chart::{Chart, Increment};
use super::motion::Motion;
use super::quaternion;
use super::tableau::STAGES;
use super::{Derivative, Rates};
use crate::lane::Lane;
use crate::lie::{Pose, Vector3, Vector6, dexp_inverse_negative, exp_se3};

/// Rates at each stage: working memory.
#[derive(Debug, Clone)]
pub struct Stages<L, const N: usize> {
    /// Rates of the chart's coordinates: of Theta; of position and vector part of the quaternion.
    pose: [Vector6<L>; STAGES],
    /// And of the scalar part.
    scalar: [L; STAGES],
    /// Joint rates.
    q: [[L; N]; STAGES],
    /// V' and q''.
    rates: [Rates<L, N>; STAGES],
    /// q and q' of the stage at hand.
    q_at: [L; N],
    qd_at: [L; N],
}

/// A stage but for its joints: what its coordinates are off from the start, and its twist.
struct Point<L> {
    pose: Vector6<L>,
    scalar: L,
    twist: Vector6<L>,
}

impl<L: Lane, const N: usize> Stages<L, N> {
    /// Fresh memory; its contents never matter.
    pub fn new() -> Self {
        let zero = [L::zero(); N];
        let rates = Rates { twist: Vector6::zero(), qd: zero };
        Self {
            pose: [Vector6::zero(); STAGES],
            scalar: [L::zero(); STAGES],
            q: [zero; STAGES],
            rates: [rates; STAGES],
            q_at: zero,
            qd_at: zero,
        }
    }

    /// The step's start.
    #[inline(always)]
    fn start(&mut self, n: usize, from: &Motion<L, N>) -> Point<L> {
        for k in 0..n {
            self.q_at[k] = from.q[k];
            self.qd_at[k] = from.qd[k];
        }
        Point { pose: Vector6::zero(), scalar: L::zero(), twist: from.twist }
    }

    /// The start plus `h sum w_j k_j`; leaves q and q' in `q_at`, `qd_at`.
    #[inline(always)]
    fn weigh(
        &mut self,
        weights: &[f64; STAGES],
        count: usize,
        n: usize,
        h: L,
        scalar: bool,
        from: &Motion<L, N>,
    ) -> Point<L> {
        let mut sum = Point { pose: Vector6::zero(), scalar: L::zero(), twist: Vector6::zero() };
        for k in 0..n {
            self.q_at[k] = L::zero();
            self.qd_at[k] = L::zero();
        }
        for j in 0..count {
            if weights[j] == 0.0 {
                continue;
            }
            let weight = h * L::c(weights[j]);
            sum.pose = self.pose[j].scale_add(weight, sum.pose);
            sum.twist = self.rates[j].twist.scale_add(weight, sum.twist);
            if scalar {
                sum.scalar = self.scalar[j].mul_add(weight, sum.scalar);
            }
            for k in 0..n {
                self.q_at[k] = self.q[j][k].mul_add(weight, self.q_at[k]);
                self.qd_at[k] = self.rates[j].qd[k].mul_add(weight, self.qd_at[k]);
            }
        }
        for k in 0..n {
            self.q_at[k] += from.q[k];
            self.qd_at[k] += from.qd[k];
        }
        sum.twist = from.twist + sum.twist;
        sum
    }
}

impl<L: Lane, const N: usize> Default for Stages<L, N> {
    fn default() -> Self {
        Self::new()
    }
}

/// The quaternion at a point.
#[inline(always)]
fn quaternion_at<L: Lane, const N: usize>(point: &Point<L>, from: &Motion<L, N>) -> [L; 4] {
    let ([w, x, y, z], [dx, dy, dz]) = (from.attitude, point.pose.angular.0);
    [w + point.scalar, x + dx, y + dy, z + dz]
}

/// One step of size `h`, which begins `elapsed` after the start of the interval.
///
/// Returns the square of the greatest rotation within the step, for charts that bound it: the result is good where it
/// stays below pi^2.
#[inline(always)]
pub fn explicit<L: Lane, D: Derivative<L, N>, const N: usize>(
    method: &Explicit,
    h: L,
    elapsed: L,
    from: &Motion<L, N>,
    to: &mut Motion<L, N>,
    derivative: &mut D,
    stages: &mut Stages<L, N>,
) -> L {
    let Explicit { tableau, chart } = *method;
    let n = derivative.joints();
    let scalar = matches!(chart, Chart::Quaternion(_));
    let mut greatest = L::zero();
    for i in 0..tableau.stages {
        let point = if i == 0 { stages.start(n, from) } else { stages.weigh(&tableau.a[i], i, n, h, scalar, from) };
        let whole;
        let at = match chart {
            Chart::Exponential(_) => {
                greatest = greatest.max(point.pose.angular.dot(point.pose.angular));
                Increment { start: &from.pose, theta: point.pose }
            }
            Chart::Quaternion(_) => {
                let rotation = quaternion::rotation(quaternion_at(&point, from));
                whole = Pose { rotation, position: from.pose.position + point.pose.linear };
                Increment { start: &whole, theta: Vector6::zero() }
            }
        };
        let time = elapsed + h * L::c(tableau.c[i]);
        derivative.rates(&at, time, point.twist, &stages.q_at, &stages.qd_at, &mut stages.rates[i]);
        stages.pose[i] = match chart {
            Chart::Exponential(_) if i == 0 => point.twist,
            Chart::Exponential(form) => dexp_inverse_negative(form, point.pose, point.twist),
            Chart::Quaternion(correction) => {
                let rate = quaternion::rate(quaternion_at(&point, from), point.twist.angular, correction);
                stages.scalar[i] = rate[0];
                let angular = Vector3([rate[1], rate[2], rate[3]]);
                Vector6 { linear: at.start.rotation.apply(point.twist.linear), angular }
            }
        };
        for k in 0..n {
            stages.q[i][k] = stages.qd_at[k];
        }
    }
    let end = stages.weigh(&tableau.b, tableau.stages, n, h, scalar, from);
    match chart {
        Chart::Exponential(_) => {
            greatest = greatest.max(end.pose.angular.dot(end.pose.angular));
            to.pose = from.pose.times(&exp_se3(end.pose));
            to.pose.rotation = to.pose.rotation.orthonormalised();
        }
        Chart::Quaternion(correction) => {
            to.attitude = quaternion::corrected(quaternion_at(&end, from), correction);
            let rotation = quaternion::rotation(to.attitude);
            to.pose = Pose { rotation, position: from.pose.position + end.pose.linear };
        }
    }
    to.twist = end.twist;
    for k in 0..n {
        to.q[k] = stages.q_at[k];
        to.qd[k] = stages.qd_at[k];
    }
    greatest
}

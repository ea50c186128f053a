//! One driver for all explicit Runge-Kutta methods. `[HC eq. 14, 17-18]`, `[PC05]`
//!
//! A stage's coordinates are the start's plus `h sum a_ij k_j`; the chart defines them and their rates. All methods share the
//! one call of the right-hand side below, which is by far the most code.

use super::chart::{Attitude, Chart, Increment};
use super::motion::Motion;
use super::registry::Explicit;
use super::stages::{Point, Stages, Weights};
use super::tableau::STAGES;
use super::{Derivative, euler_angles, quaternion};
use crate::lane::Lane;
use crate::lie::{DexpInverse, Matrix3, Pose, Vector3, Vector6, dexp_inverse_negative};

/// Measurements of one step.
pub(super) struct Report<L> {
    /// Square of the maximum rotation within the step, for charts that bound it: valid below pi^2.
    pub turn: L,
    /// Square of the estimated error, for tableaus with an embedded method, else 0.
    pub error: L,
    /// Differences between the stages: see [`Stages::contrast`].
    pub contrast: [L; 3],
}

/// Kept attitude at a point: a quaternion, or 0 and three angles.
#[inline(always)]
fn attitude_at<L: Lane, const N: usize>(point: &Point<L>, from: &Motion<L, N>) -> [L; 4] {
    let ([w, x, y, z], [dx, dy, dz]) = (from.attitude, point.pose.angular.0);
    [w + point.scalar, x + dx, y + dy, z + dz]
}

/// Rotation of a kept attitude, and its rates at a spin `omega`.
#[inline(always)]
fn kinematics<L: Lane>(chart: Chart, attitude: [L; 4], omega: Vector3<L>) -> (Matrix3<L>, [L; 4]) {
    match chart {
        Chart::Quaternion(correction) => {
            (quaternion::rotation(attitude), quaternion::rate(attitude, omega, correction))
        }
        _ => euler_angles::rotation_and_rates(attitude, omega),
    }
}

/// One step of size `h`, which begins `elapsed` after the start of the interval; with `begun` the first stage's rates
/// are known. Charts that keep the attitude exist where `BASELINES` holds. Returns its measurements and its end,
/// whose joints are left in the stages.
#[inline(always)]
pub(super) fn explicit<L: Lane, D: Derivative<L, N>, const N: usize, const BASELINES: bool>(
    method: &Explicit,
    (h, elapsed, begun): (L, L, bool),
    from: &Motion<L, N>,
    derivative: &mut D,
    stages: &mut Stages<L, N>,
) -> (Report<L>, Point<L>) {
    let Explicit { tableau, chart, .. } = *method;
    let n = derivative.joints();
    let keeps = BASELINES && chart.attitude() != Attitude::Matrix;
    let mut turn = L::zero();
    for i in usize::from(begun)..tableau.stages.min(STAGES) {
        let point =
            if i == 0 { stages.start(n, from) } else { stages.weigh(&Weights::of(tableau, i), n, h, keeps, from) };
        let displaced;
        let at = if keeps {
            let (rotation, [w, x, y, z]) = kinematics(chart, attitude_at(&point, from), point.twist.angular);
            displaced = Pose { rotation, position: from.pose.position + point.pose.linear };
            stages.scalar[i] = w;
            stages.pose[i] = Vector6 { linear: rotation.apply(point.twist.linear), angular: Vector3([x, y, z]) };
            Increment { start: &displaced, theta: None }
        } else {
            turn = turn.max(point.pose.angular.dot(point.pose.angular));
            Increment { start: &from.pose, theta: if i > 0 { Some(point.pose) } else { None } }
        };
        // Here, because it fills the latency of the stage's gravity.
        match chart {
            _ if keeps => {}
            Chart::Exponential if i > 0 => {
                stages.pose[i] = dexp_inverse_negative(DexpInverse::Closed, point.pose, point.twist);
            }
            _ => stages.pose[i] = point.twist,
        }
        let time = elapsed + h * L::c(tableau.c[i]);
        derivative.rates(&at, time, point.twist, &stages.q_at, &stages.qd_at, &mut stages.rates[i]);
    }
    let contrast = match &tableau.contrast {
        Some(contrast) => stages.contrast(contrast, n, h, from),
        None => [L::zero(); 3],
    };
    let error = match &tableau.error {
        Some(weights) => stages.error(tableau, weights, n, h, from),
        None => L::zero(),
    };
    let weights =
        Weights { time: 1.0, speed: &tableau.b, place: &tableau.place_end, support: &tableau.support[STAGES] };
    let mut end = stages.weigh(&weights, n, h, keeps, from);
    if chart == Chart::VelocityFirst {
        end.pose = end.twist.scale(h);
        for k in 0..n {
            stages.q_at[k] = stages.qd_at[k].mul_add(h, from.q[k]);
        }
    }
    if !keeps {
        turn = turn.max(end.pose.angular.dot(end.pose.angular));
    }
    (Report { turn, error, contrast }, end)
}

/// Moves to the end of a step where the mask holds.
#[inline(always)]
pub(super) fn move_to_end<L: Lane, const N: usize, const BASELINES: bool>(
    chart: Chart,
    mask: L::Mask,
    end: &Point<L>,
    stages: &Stages<L, N>,
    motion: &mut Motion<L, N>,
    n: usize,
) {
    let joints = (&stages.q_at, &stages.qd_at);
    if !BASELINES || chart.attitude() == Attitude::Matrix {
        motion.move_by(mask, end.pose, end.twist, joints, n);
        return;
    }
    let mut attitude = attitude_at(end, motion);
    if let Chart::Quaternion(correction) = chart {
        attitude = quaternion::corrected(attitude, correction);
    }
    let (rotation, _) = kinematics(chart, attitude, end.twist.angular);
    let (position, rest) = motion.travelled(end.pose.linear);
    motion.set_where(mask, Pose { rotation, position }, rest, end.twist, joints, n);
    motion.set_attitude_where(mask, &attitude);
}

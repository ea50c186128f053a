//! Adjoint of a sub-interval of an explicit method on the exponential map: reverse differentiation of the stages.

use super::Rates;
use super::motion::Motion;
use super::motion_adjoint::{
    DerivativeAdjoint, MethodAdjoint, MotionCotangents, PoseCotangents, StageCotangents, StagePoint,
};
use super::recorder::SubInterval;
use super::registry::Explicit;
use super::stages::{Stages, Weights};
use super::tableau::STAGES;
use crate::lane::{Lane, Tape};
use crate::lie::{DexpInverse, Vector3, Vector6, dexp_inverse_adjoint, dexp_inverse_negative};

/// Memory of the adjoint: rates and states of the stages, and their cotangents.
#[derive(Debug, Clone)]
pub struct ExplicitAdjoint<L, const N: usize> {
    stages: Stages<L, N>,
    theta: [Vector6<L>; STAGES],
    twist: [Vector6<L>; STAGES],
    q: [[L; N]; STAGES],
    qd: [[L; N]; STAGES],
    of_rates: [Rates<L, N>; STAGES],
    of_pose: [Vector6<L>; STAGES],
    of_stage: StageCotangents<L, N>,
    part: SubInterval<L, N>,
    of_start: MotionCotangents<L, N>,
}

impl<L: Lane, const N: usize> ExplicitAdjoint<L, N> {
    /// Zeroed memory.
    pub fn blank() -> Self {
        let (six, joints) = ([Vector6::zero(); STAGES], [[L::zero(); N]; STAGES]);
        Self {
            stages: Stages::blank(),
            theta: six,
            twist: six,
            q: joints,
            qd: joints,
            of_rates: [Rates::zero(); STAGES],
            of_pose: six,
            of_stage: StageCotangents::blank(),
            part: SubInterval::blank(),
            of_start: MotionCotangents::zero(),
        }
    }
}

impl<L: Lane, const N: usize> MethodAdjoint<L, N> for ExplicitAdjoint<L, N> {
    type Method = Explicit;

    #[inline(always)]
    fn start(&self) -> &Motion<L, N> {
        &self.part.from
    }

    #[inline(always)]
    fn reverse<D: DerivativeAdjoint<L, N>>(
        &mut self,
        method: &Explicit,
        tape: &mut Tape<L::Real>,
        derivative: &mut D,
        of: &mut MotionCotangents<L, N>,
    ) {
        let Explicit { tableau, .. } = *method;
        let (n, count) = (derivative.joints(), tableau.stages.min(STAGES));
        let Self { stages, theta, twist, q, qd, of_rates, of_pose, of_stage, part, of_start } = self;
        let takes = part.pop(tape, &mut stages.rates[..count], of, n);
        let SubInterval { from, h, elapsed, of_end: of_last, .. } = &*part;
        let h = *h;
        for i in 0..count {
            let point =
                if i == 0 { stages.start(n, from) } else { stages.weigh(&Weights::of(tableau, i), n, h, false, from) };
            (theta[i], twist[i]) = (point.pose, point.twist);
            for k in 0..n {
                (q[i][k], qd[i][k]) = (stages.q_at[k], stages.qd_at[k]);
            }
            stages.pose[i] =
                if i == 0 { point.twist } else { dexp_inverse_negative(DexpInverse::Closed, point.pose, point.twist) };
        }
        let mut end = Vector6::zero();
        for i in 0..count {
            end = stages.pose[i].scale_add(h * L::c(tableau.b[i]), end);
        }

        (of_start.position, of_start.turn, of_start.twist) = (Vector3::zero(), Vector3::zero(), of_last.twist);
        let of_end = PoseCotangents { position: Some(of_last.position), turn: of_last.turn };
        let of_end = of_end.pull_back(end, &from.pose, of_start);
        for k in 0..n {
            (of_start.q[k], of_start.qd[k]) = (of_last.q[k], of_last.q[k].mul_add(h, of_last.qd[k]));
        }
        for i in 0..count {
            let (speed, place) = (h * L::c(tableau.b[i]), h * h * L::c(tableau.place_end[i]));
            of_pose[i] = of_end.scale(speed);
            of_rates[i].twist = of_last.twist.scale(speed);
            for k in 0..n {
                of_rates[i].qd[k] = of_last.qd[k].mul_add(speed, of_last.q[k] * place);
            }
        }
        for i in (0..count).rev() {
            let at = StagePoint { start: &from.pose, theta: theta[i], twist: twist[i], q: &q[i], qd: &qd[i] };
            let time = h.mul_add(L::c(tableau.c[i]), *elapsed);
            derivative.rates_adjoint(&at, (time, None), &stages.rates[i], &of_rates[i], of_stage);
            if i == 0 {
                of_start.twist = of_start.twist + of_stage.twist + of_pose[0];
                of_start.turn = of_start.turn + of_stage.pose.turn;
                if let Some(position) = of_stage.pose.position {
                    of_start.position = of_start.position + position;
                }
                for k in 0..n {
                    of_start.q[k] += of_stage.q[k];
                    of_start.qd[k] += of_stage.qd[k];
                }
                break;
            }
            let (of_theta, of_twist) = dexp_inverse_adjoint(DexpInverse::Closed, theta[i], twist[i], of_pose[i]);
            let of_twist = of_stage.twist + of_twist;
            let of_theta = of_theta + of_stage.pose.pull_back(theta[i], &from.pose, of_start);
            of_start.twist = of_start.twist + of_twist;
            let way = h * L::c(tableau.c[i]);
            for k in 0..n {
                of_start.q[k] += of_stage.q[k];
                of_start.qd[k] += of_stage.q[k].mul_add(way, of_stage.qd[k]);
            }
            let [speeds, places] = &tableau.support[i];
            for s in 0..speeds.count() {
                let j = speeds.stage(s);
                let speed = h * L::c(tableau.a[i][j]);
                of_rates[j].twist = of_twist.scale_add(speed, of_rates[j].twist);
                of_pose[j] = of_theta.scale_add(speed, of_pose[j]);
                for k in 0..n {
                    of_rates[j].qd[k] = of_stage.qd[k].mul_add(speed, of_rates[j].qd[k]);
                }
            }
            for s in 0..places.count() {
                let j = places.stage(s);
                let place = h * h * L::c(tableau.place[i][j]);
                for k in 0..n {
                    of_rates[j].qd[k] = of_stage.q[k].mul_add(place, of_rates[j].qd[k]);
                }
            }
        }
        of.set_where(takes, of_start, n);
    }
}

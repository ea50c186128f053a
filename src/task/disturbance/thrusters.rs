//! Loss of thrust.

use super::column::Column;
use super::component::{Component, Draws, Forcing, Moment, Place, component};
use super::context::DisturbanceContext;
use super::current::smooth_step;
use super::span::{Span, refuse};
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows};

component! {
    /// Thrusters, drawn at random, that give only a part of the commanded thrust from a time on.
    pub struct ThrusterLoss = "thrusters" {
        /// Number of thrusters.
        count: usize = 1;
        /// Remaining gain of each one.
        gain: Span = Span::of(0.3, 0.7), in 0.0, 2.0;
        /// Time of the loss, s.
        time: Span = Span::of(0.0, 8.0), in 0.0, 1e6;
        /// Duration of the loss, s.
        fade: f64 = 0.0, in 0.0, 1e6;
        /// Remaining gain of each thruster, in the scene's order; in place of `count` and `gain`.
        #[serde(skip_serializing_if = "Option::is_none")]
        gains: Option<Vec<f64>> = None, in 0.0, 2.0;
    }
}

impl ThrusterLoss {
    /// Rows: time of the loss in control periods, and one over its duration; then the remaining gain of each thruster. Zeros
    /// stand for no loss.
    const COMMON: usize = 2;
}

impl Component for ThrusterLoss {
    const STREAM: u32 = 38;

    fn check(&self, context: &DisturbanceContext) -> Result<(), TaskError> {
        match &self.gains {
            Some(gains) if gains.len() != context.thrusters => {
                let reason = format!("{} gains, but the scene has {} thrusters", gains.len(), context.thrusters);
                refuse("thrusters.gains", reason)
            }
            _ => Ok(()),
        }
    }

    fn rows(_size: usize, context: &DisturbanceContext) -> usize {
        Self::COMMON + context.thrusters
    }

    fn begin<T: Real>(&self, memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let Draws { stream: draw, context, .. } = draws;
        let time = self.time.at(draw.uniform(0)) / context.period;
        // At least a period; shorter times are steps.
        let pace = 1.0 / (self.fade / context.period).max(1.0);
        let gains = self.gains.clone().unwrap_or_else(|| {
            let (mut gains, mut left) = (vec![1.0; context.thrusters], (0..context.thrusters).collect::<Vec<_>>());
            for k in 0..self.count.min(context.thrusters) as u32 {
                let which = (draw.uniform(1 + 2 * k) * left.len() as f64) as usize;
                let which = left.swap_remove(which.min(left.len() - 1));
                gains[which] = self.gain.at(draw.uniform(2 + 2 * k));
            }
            gains
        });
        memory.set_all(at.row, [time, pace].into_iter().chain(gains));
    }

    #[inline(always)]
    fn add<L: Lane>(memory: &Rows<'_, L::Real>, at: Place, moment: &Moment<'_, L>, forcing: &mut Forcing<L>) {
        let [time, pace]: [L; 2] = memory.get_all(at.row);
        let lost = smooth_step((moment.now + L::c(1.0) - time) * pace);
        for k in 0..moment.thrusters {
            let left: L = memory.get(at.row + Self::COMMON + k);
            forcing.gains[k] = (left - L::c(1.0)).mul_add(lost, L::c(1.0));
        }
    }
}

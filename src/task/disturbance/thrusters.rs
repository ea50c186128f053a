//! Loss of thrust.

use serde::{Deserialize, Serialize};

use super::column::Column;
use super::component::{Component, Draws, Forcing, Moment, Place};
use super::context::DisturbanceContext;
use super::span::{Span, check, refuse};
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows};

use super::current::smooth_step;

/// Thrusters, drawn at random, that give only a part of the commanded thrust from a time on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ThrusterLoss {
    /// Number of thrusters.
    pub count: usize,
    /// Remaining gain of each one.
    pub gain: Span,
    /// Time of the loss, s.
    pub time: Span,
    /// Duration of the loss, s.
    pub fade: f64,
    /// Remaining gain of each thruster, in the scene's order; in place of `count` and `gain`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gains: Option<Vec<f64>>,
}

impl Default for ThrusterLoss {
    fn default() -> Self {
        Self { count: 1, gain: Span::of(0.3, 0.7), time: Span::of(0.0, 8.0), fade: 0.0, gains: None }
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
        self.gain.check("thrusters.gain", 0.0, 2.0)?;
        self.time.check("thrusters.time", 0.0, 1e6)?;
        check("thrusters.fade", self.fade, 0.0, 1e6)?;
        let gains = self.gains.as_deref().unwrap_or_default();
        if self.gains.is_some() && gains.len() != context.thrusters {
            let reason = format!("{} gains, but the scene has {} thrusters", gains.len(), context.thrusters);
            return refuse("thrusters.gains", reason);
        }
        gains.iter().try_for_each(|gain| check("thrusters.gains", *gain, 0.0, 2.0))
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

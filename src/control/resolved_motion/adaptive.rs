//! Gains of resolved motion on a bank of models.

use serde::{Deserialize, Serialize};

use super::gains::ResolvedMotionGains;
use crate::control::bank::{Bank, BankModel};

/// Gains of [`ResolvedMotion`](super::ResolvedMotion) on a bank of models of delay and thrust.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AdaptiveMotionGains {
    /// Gains of each model's resolved motion without delay. `delay` is the maximum of the bank, which begins at 0.
    #[serde(flatten)]
    pub motion: ResolvedMotionGains,
    /// Decrease of `pose_gain`, and of `twist_gain` and `joint_gain`, with a model's delay tau: gains over `1 + a tau`,
    /// 1/s.
    pub delay_schedule: [f64; 2],
    /// Motion per commanded wrench over the nominal model's.
    pub thrust_factors: [f64; 3],
    /// Standard deviation of innovations of the velocities: linear, angular and of joints, m/s and rad/s.
    pub innovation: [f64; 3],
    /// Time constant of forgetting, s; 0: none.
    pub memory_time: f64,
}

impl Default for AdaptiveMotionGains {
    fn default() -> Self {
        let motion = ResolvedMotionGains { observer_bandwidth: [4.0, 4.0, 8.0], ..ResolvedMotionGains::default() };
        Self {
            motion,
            delay_schedule: [0.0; 2],
            thrust_factors: [0.6, 1.0, 1.6],
            innovation: [0.1, 0.2, 0.02],
            memory_time: 10.0,
        }
    }
}

impl AdaptiveMotionGains {
    /// Gains of a bank's models.
    pub(super) fn models(&self, bank: &Bank<3>, period: f64) -> Vec<ResolvedMotionGains> {
        let gains = |BankModel { delay, .. }: &BankModel| {
            let [pose, rate] = self.delay_schedule.map(|a| 1.0 / (1.0 + a * *delay as f64 * period));
            ResolvedMotionGains {
                pose_gain: self.motion.pose_gain * pose,
                twist_gain: self.motion.twist_gain * rate,
                joint_gain: self.motion.joint_gain * rate,
                delay: *delay,
                ..self.motion.clone()
            }
        };
        bank.models.iter().map(gains).collect()
    }

    pub(super) fn bank(&self, period: f64) -> Bank<3> {
        Bank::new(self.motion.delay, self.thrust_factors, self.innovation, [self.memory_time, period])
    }
}

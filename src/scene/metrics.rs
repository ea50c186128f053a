//! What an episode reports after every control period.

use nalgebra::Vector3;

/// Terms of the reward, each with its weight; the reward is their sum.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RewardTerms {
    /// Pose error.
    pub pose: f64,
    /// Effort.
    pub effort: f64,
    /// Change of the action.
    pub rate: f64,
}

/// Measures at a control instant, and their running means over the episode's instants so far (the start excluded).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Metrics {
    /// Distance from the target, m.
    pub position_error: f64,
    /// Angle from the target, rad.
    pub attitude_error: f64,
    /// Distance of the end effector from where target and joint reference would have it, m.
    pub end_effector_position_error: f64,
    /// Angle of the end effector likewise, rad.
    pub end_effector_attitude_error: f64,
    /// Mean over thrusters of `(|T_i| / T_max)^1.5`, as shaft power grows with thrust: 1 is all at full power.
    pub effort: f64,
    /// Share of thrusters at full thrust.
    pub saturation: f64,
    /// Root mean square or, for the last two, mean of the six above, in their order.
    pub running: [f64; 6],
    /// Current in world axes, m/s.
    pub current: Vector3<f64>,
}

/// What a control period brought.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Sum of the terms.
    pub reward: f64,
    /// Terms of the reward.
    pub terms: RewardTerms,
    /// The episode is over. Running out of time is not the task's business.
    pub terminated: bool,
    /// The state left its bounds or the real numbers; the only reason to terminate.
    pub diverged: bool,
    /// Measures.
    pub metrics: Metrics,
}

impl Outcome {
    /// Names of [`Outcome::info`], the same at every step.
    pub const INFO: [&'static str; 18] = [
        "position_error",
        "attitude_error",
        "end_effector_position_error",
        "end_effector_attitude_error",
        "effort",
        "saturation",
        "rms_position_error",
        "rms_attitude_error",
        "rms_end_effector_position_error",
        "rms_end_effector_attitude_error",
        "mean_effort",
        "mean_saturation",
        "current_x",
        "current_y",
        "current_z",
        "reward_pose",
        "reward_effort",
        "reward_rate",
    ];

    /// All measures and reward terms, in the order of [`Outcome::INFO`].
    pub fn info(&self) -> [f64; 18] {
        let (m, t) = (&self.metrics, &self.terms);
        let mut info = [0.0; 18];
        info[..6].copy_from_slice(&m.instant());
        info[6..12].copy_from_slice(&m.running);
        info[12..15].copy_from_slice(m.current.as_slice());
        info[15..].copy_from_slice(&[t.pose, t.effort, t.rate]);
        info
    }
}

impl Metrics {
    fn instant(&self) -> [f64; 6] {
        [
            self.position_error,
            self.attitude_error,
            self.end_effector_position_error,
            self.end_effector_attitude_error,
            self.effort,
            self.saturation,
        ]
    }

    /// Adds this instant to `sums` and fills in the running means over `count` instants.
    pub(super) fn accumulate(&mut self, sums: &mut [f64; 6], count: u32) {
        for (k, value) in self.instant().into_iter().enumerate() {
            let square = k < 4;
            sums[k] += if square { value * value } else { value };
            let mean = sums[k] / f64::from(count);
            self.running[k] = if square { mean.sqrt() } else { mean };
        }
    }
}

//! What an episode reports after every control period.

use nalgebra::Vector3;

use crate::lane::Lane;

/// Terms of the reward, each with its weight; the reward is their sum.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RewardTerms {
    /// Pose error.
    pub pose: f64,
    /// Effort.
    pub effort: f64,
    /// Change of the action.
    pub rate: f64,
    /// Divergence.
    pub diverged: f64,
}

/// Measures at a control instant, and their running means over the episode's instants so far (the start excluded).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Metrics {
    /// Distance of the vehicle, or of the end effector that follows a path, from where it is to be, m.
    pub position_error: f64,
    /// Angle likewise, rad.
    pub attitude_error: f64,
    /// Distance of the end effector from its path, or from where target and joint reference would have it, m.
    pub end_effector_position_error: f64,
    /// Angle of the end effector likewise, rad.
    pub end_effector_attitude_error: f64,
    /// Mean over thrusters, and joints that are acted on, of `(|T_i| / T_max)^1.5`, as shaft power grows with thrust: 1 is all at full power.
    pub effort: f64,
    /// Share of them at their limit.
    pub saturation: f64,
    /// Root mean square or, for the last two, mean of the six above, in their order.
    pub running: [f64; 6],
    /// Current in world axes, m/s.
    pub current: Vector3<f64>,
    /// Whether both errors are within their tolerances.
    pub success: bool,
    /// Share of the instants so far at which they were.
    pub mean_success: f64,
    /// For how long they have not been, s: since they last left their tolerances, up to now or to when they came back.
    /// What an episode needs from its start counts too.
    pub recovery_time: f64,
    /// Force of other disturbances than the water, N.
    pub disturbance_force: f64,
    /// Payload, kg.
    pub payload: f64,
    /// What is left of the thrust of the weakest thruster.
    pub thruster_gain: f64,
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
    pub const INFO: [&'static str; 26] = [
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
        "success",
        "mean_success",
        "recovery_time",
        "diverged",
        "reward_diverged",
        "disturbance_force",
        "payload",
        "thruster_gain",
    ];

    /// All measures and reward terms, in the order of [`Outcome::INFO`].
    pub fn info(&self) -> [f64; INFO] {
        let (m, t) = (&self.metrics, &self.terms);
        let instant = [
            m.position_error,
            m.attitude_error,
            m.end_effector_position_error,
            m.end_effector_attitude_error,
            m.effort,
            m.saturation,
        ];
        let mut info = [0.0; INFO];
        info[..6].copy_from_slice(&instant);
        info[6..12].copy_from_slice(&m.running);
        info[12..15].copy_from_slice(m.current.as_slice());
        info[15..18].copy_from_slice(&[t.pose, t.effort, t.rate]);
        let flag = |yes: bool| f64::from(u8::from(yes));
        let last = [flag(m.success), m.mean_success, m.recovery_time, flag(self.diverged), t.diverged];
        info[18..23].copy_from_slice(&last);
        info[23..].copy_from_slice(&[m.disturbance_force, m.payload, m.thruster_gain]);
        info
    }
}

impl From<&Judgement<f64>> for Outcome {
    fn from(judgement: &Judgement<f64>) -> Self {
        let info = &judgement.info;
        let metrics = Metrics {
            position_error: info[0],
            attitude_error: info[1],
            end_effector_position_error: info[2],
            end_effector_attitude_error: info[3],
            effort: info[4],
            saturation: info[5],
            running: std::array::from_fn(|k| info[6 + k]),
            current: Vector3::new(info[12], info[13], info[14]),
            success: info[18] != 0.0,
            mean_success: info[19],
            recovery_time: info[20],
            disturbance_force: info[23],
            payload: info[24],
            thruster_gain: info[25],
        };
        let terms = RewardTerms { pose: info[15], effort: info[16], rate: info[17], diverged: info[22] };
        let diverged = !judgement.sound;
        Self { reward: judgement.reward, terms, terminated: diverged, diverged, metrics }
    }
}

/// Number of measures and reward terms.
pub const INFO: usize = Outcome::INFO.len();

/// [`Outcome`] of a group of instances.
#[derive(Debug, Clone, Copy)]
pub struct Judgement<L: Lane> {
    /// Sum of the reward's terms.
    pub reward: L,
    /// Measures and terms, in the order of [`Outcome::INFO`].
    pub info: [L; INFO],
    /// Where the state is within its bounds.
    pub sound: L::Mask,
}

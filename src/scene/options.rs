//! What a user may choose about a task.

use serde::{Deserialize, Serialize};
use toml::Value;

use crate::control::ActionKind;
use crate::error::TaskError;

/// Options of a task; each has a default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TaskOptions {
    /// What is to be done.
    pub task: Goal,
    /// What the entries of an action stand for.
    pub action: ActionKind,
    /// Physics step, s.
    pub dt: f64,
    /// Physics steps per control period.
    pub substeps: u32,
    /// Greatest speed of the drawn current, m/s. It comes on top of the scene's own current.
    pub max_current: f64,
    /// Greatest initial distance from the target, m.
    pub start_distance: f64,
    /// Greatest initial attitude error, rad.
    pub start_angle: f64,
    /// Greatest distance of a drawn target from the world origin, m; 0 for a target at the origin.
    pub target_distance: f64,
    /// Greatest turn of a drawn target about the vertical, either way, rad; 0 for identity attitude.
    pub target_turn: f64,
    /// Greatest swing of the arm's reference about home, rad (a quarter of it in metres for prismatic joints).
    pub arm_amplitude: f64,
    /// Reward weights.
    pub reward: RewardWeights,
}

impl Default for TaskOptions {
    fn default() -> Self {
        Self {
            task: Goal::StationKeep,
            action: ActionKind::Wrench,
            dt: 0.01,
            substeps: 5,
            max_current: 0.3,
            start_distance: 0.05,
            start_angle: 0.05,
            target_distance: 0.0,
            target_turn: 0.0,
            arm_amplitude: 0.4,
            reward: RewardWeights::default(),
        }
    }
}

/// What a task asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Goal {
    /// The vehicle holds a pose while the arm moves.
    #[default]
    StationKeep,
}

impl Goal {
    /// Name, as Gymnasium knows it.
    pub fn name(self) -> &'static str {
        match self {
            Goal::StationKeep => "UVMS-StationKeep",
        }
    }
}

/// Weights of the reward's terms.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RewardWeights {
    /// Of the pose error.
    pub pose: f64,
    /// Of the mean squared relative thrust.
    pub effort: f64,
    /// Of the mean squared change of the action.
    pub rate: f64,
}

impl Default for RewardWeights {
    fn default() -> Self {
        Self { pose: 0.1, effort: 0.02, rate: 0.1 }
    }
}

impl TaskOptions {
    /// From plain values, such as Python has them.
    ///
    /// # Errors
    /// `TaskError::Options` for a key that there is not, or a value of the wrong kind.
    pub fn from_value(value: Value) -> Result<Self, TaskError> {
        serde_path_to_error::deserialize(value).map_err(|error| TaskError::Options(error.to_string()))
    }

    /// As plain values.
    ///
    /// # Errors
    /// `TaskError::Options`, which does not happen.
    pub fn to_value(&self) -> Result<Value, TaskError> {
        Value::try_from(self).map_err(|error| TaskError::Options(error.to_string()))
    }

    /// Control period `dt * substeps`, s.
    pub fn control_period(&self) -> f64 {
        self.dt * f64::from(self.substeps)
    }

    /// Refuses values that make no task.
    pub(super) fn check(&self) -> Result<(), TaskError> {
        let refuse = |name, value, allowed| Err(TaskError::Option { name, value, allowed });
        if !(self.dt > 0.0 && self.dt <= 1.0) {
            return refuse("dt", self.dt, "in (0, 1] s");
        }
        if self.substeps == 0 || self.substeps > 10_000 {
            return refuse("substeps", f64::from(self.substeps), "1 to 10000");
        }
        for (name, value) in [
            ("max_current", self.max_current),
            ("start_angle", self.start_angle),
            ("target_distance", self.target_distance),
            ("target_turn", self.target_turn),
            ("arm_amplitude", self.arm_amplitude),
            ("reward.pose", self.reward.pose),
            ("reward.effort", self.reward.effort),
            ("reward.rate", self.reward.rate),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return refuse(name, value, "finite and >= 0");
            }
        }
        if !(self.start_distance >= 0.0 && self.start_distance < super::observation::POSITION_BOUND) {
            return refuse("start_distance", self.start_distance, "in [0, 10) m");
        }
        Ok(())
    }
}

/// Parts of an episode's start that are given rather than drawn. World axes unless said otherwise.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StartOverride {
    /// Vehicle origin, m.
    pub position: Option<[f64; 3]>,
    /// Vehicle attitude as a quaternion [w, x, y, z], body to world; normalised here.
    pub attitude: Option<[f64; 4]>,
    /// Absolute body twist `[v; omega]` in body axes, m/s and rad/s.
    pub twist: Option<[f64; 6]>,
    /// Joint coordinates, rad or m; the reference starts there.
    pub q: Option<Vec<f64>>,
    /// Joint rates, rad/s or m/s.
    pub qd: Option<Vec<f64>>,
    /// Target position, m.
    pub target_position: Option<[f64; 3]>,
    /// Target attitude as a quaternion [w, x, y, z].
    pub target_attitude: Option<[f64; 4]>,
    /// Whole current, m/s, the scene's own included.
    pub current: Option<[f64; 3]>,
}

//! What a user may choose about a task.

use serde::{Deserialize, Serialize};
use toml::Value;

use super::disturbance::{Disturbance, Parameters};
use super::path::PathKind;
use crate::control::ActionKind;
use crate::error::TaskError;

/// Most points that are seen ahead.
pub const PREVIEW: usize = 8;

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
    /// Greatest speed of the drawn current, m/s, where no disturbance is given. It comes on top of the scene's own
    /// current.
    pub max_current: f64,
    /// What disturbs episodes; a steady current where it is absent. Plain values have it as JSON.
    #[serde(with = "as_json", skip_serializing_if = "Option::is_none")]
    pub disturbance: Option<Disturbance>,
    /// Factors on the scene's parameters, in place of those of the disturbance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub randomize: Option<Parameters>,
    /// Time constant of all thrusters, s, in place of the scene's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub thruster_lag: Option<f64>,
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
    /// Errors below which a pose counts as reached.
    pub tolerance: Tolerance,
    /// Greatest correction to the classical controller's action, where that is what actions are; 1 is an actuator's limit.
    pub residual: f64,
    /// Kind of path that an end effector follows.
    pub reference: PathKind,
    /// Its amplitude or radius, m; 50 to 100 % of it are drawn.
    pub reference_size: f64,
    /// Its greatest speed, m/s; 50 to 100 % of it are drawn.
    pub reference_speed: f64,
    /// Its greatest amplitude of turns about the vertical, rad; less than a third of it out of the horizontal.
    pub reference_turn: f64,
    /// Points seen ahead.
    pub preview: Preview,
}

/// Points of a reference that are seen ahead.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Preview {
    /// Their number.
    pub points: u32,
    /// Time between them, and from now to the first, s.
    pub spacing: f64,
}

impl Default for Preview {
    fn default() -> Self {
        Self { points: 3, spacing: 0.2 }
    }
}

/// Errors below which a pose counts as reached.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Tolerance {
    /// m.
    pub position: f64,
    /// rad.
    pub attitude: f64,
}

impl Default for Tolerance {
    fn default() -> Self {
        Self { position: 0.05, attitude: 0.1 }
    }
}

impl Default for TaskOptions {
    fn default() -> Self {
        Self {
            task: Goal::StationKeep,
            action: ActionKind::Wrench,
            dt: 0.01,
            substeps: 5,
            max_current: 0.3,
            disturbance: None,
            randomize: None,
            thruster_lag: None,
            start_distance: 0.05,
            start_angle: 0.05,
            target_distance: 0.0,
            target_turn: 0.0,
            arm_amplitude: 0.4,
            reward: RewardWeights::default(),
            tolerance: Tolerance::default(),
            residual: 0.3,
            reference: PathKind::Mixed,
            reference_size: 0.4,
            reference_speed: 0.2,
            reference_turn: 0.4,
            preview: Preview::default(),
        }
    }
}

/// What a task asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Goal {
    /// The vehicle holds a pose while its arm moves.
    #[default]
    StationKeep,
    /// The end effector follows a path; vehicle and joints are acted on.
    #[serde(rename = "ee-track")]
    Track,
}

impl Goal {
    /// Name, as Gymnasium knows it.
    pub fn name(self) -> &'static str {
        match self {
            Goal::StationKeep => "UVMS-StationKeep",
            Goal::Track => "UVMS-EETrack",
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
    /// What divergence costs.
    pub diverged: f64,
}

impl Default for RewardWeights {
    fn default() -> Self {
        Self { pose: 0.1, effort: 0.02, rate: 0.1, diverged: 0.0 }
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

    /// What disturbs episodes.
    pub fn disturbance(&self) -> Disturbance {
        let given = self.disturbance.clone().unwrap_or_else(|| Disturbance::steady(self.max_current));
        match &self.randomize {
            Some(parameters) => Disturbance { parameters: parameters.any(), ..given },
            None => given,
        }
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
            ("reward.diverged", self.reward.diverged),
            ("tolerance.position", self.tolerance.position),
            ("tolerance.attitude", self.tolerance.attitude),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return refuse(name, value, "finite and >= 0");
            }
        }
        for (name, value, greatest, allowed) in [
            ("residual", self.residual, 1.0, "in [0, 1]"),
            ("reference_size", self.reference_size, 5.0, "in [0, 5] m"),
            ("reference_speed", self.reference_speed, 2.0, "in [0, 2] m/s"),
            ("reference_turn", self.reference_turn, 0.6, "in [0, 0.6] rad"),
            ("preview.points", f64::from(self.preview.points), PREVIEW as f64, "0 to 8"),
            ("preview.spacing", self.preview.spacing, 10.0, "in [0, 10] s"),
        ] {
            if !(0.0..=greatest).contains(&value) {
                return refuse(name, value, allowed);
            }
        }
        if let Some(lag) = self.thruster_lag.filter(|lag| !(0.0..=10.0).contains(lag)) {
            return refuse("thruster_lag", lag, "in [0, 10] s");
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
    /// Steady current, m/s, the scene's own included.
    pub current: Option<[f64; 3]>,
    /// Disturbance in place of the task's; it has no components that the task's has not.
    pub disturbance: Option<Disturbance>,
}

/// Disturbances as JSON among plain values.
mod as_json {
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    use super::Disturbance;

    pub fn serialize<S: Serializer>(given: &Option<Disturbance>, to: S) -> Result<S::Ok, S::Error> {
        match given {
            Some(disturbance) => to.serialize_str(&disturbance.to_json()),
            None => to.serialize_none(),
        }
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Disturbance>, D::Error> {
        let text = String::deserialize(from)?;
        Disturbance::from_json(&text).map(Some).map_err(Error::custom)
    }
}

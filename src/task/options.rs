//! Options that all tasks share, and starts of episodes.

use serde::{Deserialize, Serialize};

use super::bounds::POSITION_BOUND;
use super::disturbance::{Disturbance, Parameters};
use super::registry::TaskKind;
use super::reward::RewardWeights;
use super::settings::settings;
use crate::control::ActionKind;
use crate::description::Integration;
use crate::error::TaskError;

settings! {
    /// Options of a task; each has a default.
    pub struct TaskOptions {
        /// The task, with its own options.
        #[serde(skip)]
        task: TaskKind = TaskKind::default();
        /// Meaning of the entries of an action.
        action: ActionKind = ActionKind::Wrench;
        /// Physics step, s.
        dt: f64 = 0.01;
        /// Physics steps per control period.
        substeps: u32 = 5;
        /// Maximum speed of the drawn current, m/s, without a disturbance. It adds to the scene's own current.
        max_current: f64 = 0.3;
        /// Disturbance of the episodes; without it a steady current. As JSON among plain values.
        #[serde(with = "as_json", skip_serializing_if = "Option::is_none")]
        disturbance: Option<Disturbance> = None;
        /// Factors on the scene's parameters, in place of the disturbance's.
        #[serde(skip_serializing_if = "Option::is_none")]
        randomize: Option<Parameters> = None;
        /// Time constant of all thrusters, s, in place of the scene's.
        #[serde(skip_serializing_if = "Option::is_none")]
        thruster_lag: Option<f64> = None;
        /// Name of the end effector in use, in place of the scene's `arm.end_effector`.
        #[serde(skip_serializing_if = "Option::is_none")]
        end_effector: Option<String> = None;
        /// Maximum initial distance from the target, m.
        start_distance: f64 = 0.05;
        /// Maximum initial attitude error, rad.
        start_angle: f64 = 0.05;
        /// Maximum distance of a drawn target from the world origin, m; 0 for a target at the origin.
        target_distance: f64 = 0.0;
        /// Maximum heading of a drawn target about the vertical, either way, rad; 0 for identity attitude.
        target_heading: f64 = 0.0;
        /// Reward weights.
        reward: RewardWeights = RewardWeights::default();
        /// Errors below which a pose counts as reached.
        tolerance: Tolerance = Tolerance::default();
        /// Maximum correction to the base controller's action with residual actions; 1 is an actuator's limit.
        residual_scale: f64 = 0.3;
    }
}

settings! {
    /// Errors below which a pose counts as reached.
    pub struct Tolerance {
        /// m.
        position: f64 = 0.05;
        /// rad.
        attitude: f64 = 0.1;
    }
}

impl TaskOptions {
    /// Disturbance of the episodes.
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

    /// The same control period in steps for this integration of the scene. A task whose default step is half of the general one
    /// has half of the scene's step.
    pub(super) fn divided_for(self, integration: &Integration) -> Self {
        let step = self.dt * (integration.step / Integration::default().step);
        if step == self.dt {
            return self;
        }
        let period = self.control_period();
        // A whole number of steps within rounding is that number.
        let substeps = (period / step - 1e-9).ceil().max(1.0);
        Self { dt: period / substeps, substeps: substeps as u32, ..self }
    }

    /// Refuses shared options out of their ranges.
    pub(super) fn check(&self) -> Result<(), TaskError> {
        check_range("dt", self.dt, self.dt > 0.0 && self.dt <= 1.0, "in (0, 1] s")?;
        let substeps = f64::from(self.substeps);
        check_range("substeps", substeps, (1..=10_000).contains(&self.substeps), "1 to 10000")?;
        check_non_negative(&[
            ("max_current", self.max_current),
            ("start_angle", self.start_angle),
            ("target_distance", self.target_distance),
            ("target_heading", self.target_heading),
        ])?;
        check_non_negative(&self.reward.named())?;
        let scale = self.reward.pose_scale;
        check_range("reward.pose_scale", scale, (1e-6..=1e3).contains(&scale), "in [1e-6, 1000] m")?;
        let Tolerance { position, attitude } = self.tolerance;
        check_non_negative(&[("tolerance.position", position), ("tolerance.attitude", attitude)])?;
        check_range("residual_scale", self.residual_scale, (0.0..=1.0).contains(&self.residual_scale), "in [0, 1]")?;
        if let Some(lag) = self.thruster_lag {
            check_range("thruster_lag", lag, (0.0..=10.0).contains(&lag), "in [0, 10] s")?;
        }
        let distance = self.start_distance;
        check_range("start_distance", distance, (0.0..POSITION_BOUND).contains(&distance), "in [0, 10) m")
    }
}

/// Refuses an option whose value is not `valid`.
pub(super) fn check_range(name: &'static str, value: f64, valid: bool, allowed: &'static str) -> Result<(), TaskError> {
    if valid { Ok(()) } else { Err(TaskError::Option { name, value, allowed }) }
}

/// Refuses numbers that are not finite or are negative.
pub(super) fn check_non_negative(values: &[(&'static str, f64)]) -> Result<(), TaskError> {
    values
        .iter()
        .try_for_each(|&(name, value)| check_range(name, value, value.is_finite() && value >= 0.0, "finite and >= 0"))
}

/// Given parts of an episode's start; the others are drawn. World axes unless said otherwise.
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
    /// Disturbance in place of the task's, with no components beyond the task's.
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

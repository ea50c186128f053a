//! Environment of a policy, and its check against another.

use serde::{Deserialize, Serialize};

use crate::control::ActionKind;
use crate::description::DEFAULT_END_EFFECTOR;
use crate::error::PolicyError;

/// Environment of a policy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicySpec {
    /// Name of the task.
    pub task: String,
    /// Name of the scene. An altered scene of the same name counts as the same.
    pub scene: String,
    /// Name of the end effector in use; files of policies leave out the scene's own.
    #[serde(default = "own_end_effector", skip_serializing_if = "is_own")]
    pub end_effector: String,
    /// Meaning of the action.
    pub action: ActionKind,
    /// Entries of an action.
    pub actions: usize,
    /// Control period, s.
    pub control_period: f64,
    /// Name and number of entries of each block of an observation, in order.
    pub observation: Vec<(String, usize)>,
}

fn own_end_effector() -> String {
    DEFAULT_END_EFFECTOR.to_owned()
}

fn is_own(end_effector: &str) -> bool {
    end_effector == DEFAULT_END_EFFECTOR
}

impl PolicySpec {
    /// Entries of an observation.
    pub fn observation_len(&self) -> usize {
        self.observation.iter().map(|(_, entries)| entries).sum()
    }

    pub(super) fn check(&self, environment: &Self) -> Result<(), PolicyError> {
        let block = |spec: &Self, i: usize| match spec.observation.get(i) {
            Some((name, entries)) => format!("{name} ({entries})"),
            None => "nothing".to_owned(),
        };
        // Not to the last digit: a period is a product, and may have passed through a file.
        let period = |spec: &Self| format!("{:.9} s", spec.control_period);
        let blocks = self.observation.len().max(environment.observation.len());
        let different = (0..blocks).find(|&i| self.observation.get(i) != environment.observation.get(i));
        let [own, other] = different.map_or_else(Default::default, |i| [self, environment].map(|spec| block(spec, i)));
        let pairs = [
            ("task", self.task.clone(), environment.task.clone()),
            ("scene", self.scene.clone(), environment.scene.clone()),
            ("end effector", self.end_effector.clone(), environment.end_effector.clone()),
            ("action", self.action.name().into(), environment.action.name().into()),
            ("number of actions", self.actions.to_string(), environment.actions.to_string()),
            ("control period", period(self), period(environment)),
            ("observation", own, other),
        ];
        match pairs.into_iter().find(|(_, own, other)| own != other) {
            None => Ok(()),
            Some((what, policy, environment)) => Err(PolicyError::Mismatch { what, policy, environment }),
        }
    }

    /// Refuses a network of other widths.
    pub(super) fn check_widths(&self, inputs: usize, outputs: usize) -> Result<(), PolicyError> {
        for (what, policy, environment) in [
            ("number of observation entries", inputs, self.observation_len()),
            ("number of actions", outputs, self.actions),
        ] {
            if policy != environment {
                let (policy, environment) = (policy.to_string(), environment.to_string());
                return Err(PolicyError::Mismatch { what, policy, environment });
            }
        }
        Ok(())
    }
}

//! Policies for tasks.

use super::Task;
use crate::control::{Pid, Purpose, Rest, Widths};
use crate::description::VehicleServo;
use crate::error::TaskError;

impl Task {
    /// No control.
    pub fn rest(&self) -> Rest {
        Rest::new(Widths { observation: self.observation_len(), memory: 0, action: self.action_len() })
    }

    /// [`Self::pd`] with an integral, whose gains follow from the others where `ki` does not give them: see [`Pid`].
    ///
    /// # Errors
    /// `TaskError` if there are no gains, or one is not finite or is negative.
    pub fn pid(&self, gains: Option<VehicleServo>, ki: Option<[f64; 6]>) -> Result<Pid, TaskError> {
        Ok(Pid::new(self.pd(gains)?, ki, self.options().control_period())?)
    }

    /// What a policy for this task says that it is for.
    pub fn purpose(&self) -> Purpose {
        Purpose {
            task: self.options().task.name().into(),
            scene: self.scene_name().into(),
            action: self.options().action,
            actions: self.action_len(),
            control_period: self.options().control_period(),
            observation: self.layout().blocks().iter().map(|block| (block.name.to_owned(), block.len())).collect(),
        }
    }
}

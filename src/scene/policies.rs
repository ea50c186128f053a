//! Policies for tasks.

use std::sync::Arc;

use super::{Goal, Task};
use crate::control::{
    ActionKind, Entries, Pid, Policy, Purpose, ResolvedGains, ResolvedMotion, Rest, TrackReading, Widths,
};
use crate::description::VehicleServo;
use crate::error::TaskError;

impl Task {
    /// No control.
    pub fn rest(&self) -> Rest {
        Rest::new(Widths { observation: self.observation_len(), memory: 0, action: self.action_len() })
    }

    /// Resolved motion, for an end effector that follows a path, with these gains or the usual ones.
    ///
    /// # Errors
    /// `TaskError` for another task, where actions are corrections to it, or for a gain that is not finite or is negative.
    pub fn resolved_motion(&self, gains: Option<ResolvedGains>) -> Result<ResolvedMotion, TaskError> {
        self.refuse_residual()?;
        self.tracker(gains)
    }

    /// What actions are corrections to, where they are: the PD with the scene's gains, or resolved motion.
    ///
    /// # Errors
    /// `TaskError` where there is no such controller.
    pub fn base(&self) -> Result<Option<Arc<dyn Policy>>, TaskError> {
        if self.options().action != ActionKind::Residual {
            return Ok(None);
        }
        Ok(Some(match self.options().task {
            Goal::StationKeep => Arc::new(self.feedback(None)?),
            Goal::Track => Arc::new(self.tracker(None)?),
        }))
    }

    fn tracker(&self, gains: Option<ResolvedGains>) -> Result<ResolvedMotion, TaskError> {
        if self.options().task != Goal::Track {
            return Err(self.unfit("resolved motion needs an end effector that follows a path: use the PD"));
        }
        let find = |names: &[&str]| {
            let mut blocks = names.iter().filter_map(|name| self.layout().block(name));
            let first =
                blocks.next().map_or_else(Entries::default, |b| Entries { offset: b.offset, scale: b.scale.clone() });
            blocks.fold(first, |mut entries, block| {
                entries.scale.extend(&block.scale);
                entries
            })
        };
        let spacing = self.options().preview.spacing;
        let ahead = self
            .layout()
            .block("preview")
            .filter(|_| spacing > 0.0)
            .map(|block| (Entries { offset: block.offset, scale: block.scale[..6].to_vec() }, spacing));
        let reading = TrackReading {
            width: self.observation_len(),
            error: find(&["position_error", "attitude_error"]),
            twist: find(&["linear_velocity", "angular_velocity"]),
            up: find(&["up"]),
            q: find(&["joint_position"]),
            qd: find(&["joint_rate"]),
            reference: find(&["reference_twist"]),
            ahead,
        };
        let (gains, period) = (gains.unwrap_or_default(), self.options().control_period());
        Ok(ResolvedMotion::new(&self.scene, reading, gains, self.actions().clone(), period)?)
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

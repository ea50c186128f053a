//! Policies for tasks.

use std::sync::Arc;

use super::{Goal, Task};
use crate::control::{
    ActionKind, BlockIndices, Controller, Law, ModelControl, ModelGains, ModelIndices, Mpc, MpcGains, NoControl,
    Observing, Pd, PdRestoring, Pid, Plant, PolicySpec, ResolvedGains, ResolvedMotion, TrackingIndices, Widths,
};
use crate::description::VehicleServo;
use crate::error::TaskError;

impl Task {
    /// No control.
    pub fn no_control(&self) -> NoControl {
        NoControl::new(Widths { observation: self.observation_len(), memory: 0, action: self.action_len() })
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
    pub fn base(&self) -> Result<Option<Arc<dyn Controller>>, TaskError> {
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
        let find = |names: &[&str]| self.entries(names);
        let spacing = self.options().preview.spacing;
        let ahead = self
            .layout()
            .block("preview")
            .filter(|_| spacing > 0.0)
            .map(|block| (BlockIndices { offset: block.offset, scale: block.scale[..6].to_vec() }, spacing));
        let reading = TrackingIndices {
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

    /// BlockIndices of these blocks, which follow each other.
    fn entries(&self, names: &[&str]) -> BlockIndices {
        let mut blocks = names.iter().filter_map(|name| self.layout().block(name));
        let first = blocks
            .next()
            .map_or_else(BlockIndices::default, |b| BlockIndices { offset: b.offset, scale: b.scale.clone() });
        blocks.fold(first, |mut entries, block| {
            entries.scale.extend(&block.scale);
            entries
        })
    }

    /// Age of what sensors show, in control periods.
    pub fn delay(&self) -> usize {
        self.disturbance().delay.as_ref().map_or(0, |delay| delay.in_periods(self.options().control_period()))
    }

    fn model_reading(&self, pd: &Pd) -> ModelIndices {
        ModelIndices {
            vehicle: pd.reading().clone(),
            arm: [self.entries(&["joint_position"]), self.entries(&["joint_rate"])],
            reference: [self.entries(&["joint_reference"]), self.entries(&["joint_reference_rate"])],
            home: self.home()[..self.joint_count()].to_vec(),
        }
    }

    /// [`Self::pd`] less weight and buoyancy: see [`PdRestoring`].
    ///
    /// # Errors
    /// As [`Self::pd`].
    pub fn pd_restoring(&self, gains: Option<VehicleServo>) -> Result<PdRestoring, TaskError> {
        let pd = self.pd(gains)?;
        let reading = self.model_reading(&pd);
        Ok(PdRestoring::new(pd, reading, self.scene()))
    }

    /// What controllers usually observe by: with a filter that expects waves, or measurements as they are.
    pub fn observing(&self, filter: bool) -> Observing {
        let delay = self.delay();
        let (waves, jolts) = if filter { ([0.3; 2], [0.05, 0.3]) } else { ([0.0; 2], [0.0; 2]) };
        Observing { observer: if filter { [8.0; 2] } else { [2.0; 2] }, waves, frequency: 1.0, jolts, delay }
    }

    /// Usual gains of [`Self::model_control`], with these gains of its feedback or such as the scene's PD has: for computed
    /// torque over the diagonal of the nominal inertia at home.
    ///
    /// # Errors
    /// `TaskError` if there are no gains.
    pub fn model_gains(&self, law: Law, kp: Option<[f64; 6]>, kd: Option<[f64; 6]>) -> Result<ModelGains, TaskError> {
        let mut own = match (kp, kd) {
            (Some(kp), Some(kd)) => VehicleServo { kp, kd },
            _ => self.pd(None)?.gains().clone(),
        };
        if law == Law::ComputedTorque {
            let inertia = Plant::new(self.scene()).inertia(self.home());
            for (gains, given) in [(&mut own.kp, kp), (&mut own.kd, kd)] {
                if given.is_none() {
                    gains.iter_mut().enumerate().for_each(|(k, gain)| *gain /= inertia[(k, k)]);
                }
            }
        }
        Ok(ModelGains {
            kp: kp.unwrap_or(own.kp),
            kd: kd.unwrap_or(own.kd),
            observing: self.observing(law == Law::ComputedTorque),
            lead: 0.0,
        })
    }

    /// Feedback on the estimate of an observer that knows the nominal model: see [`ModelControl`].
    ///
    /// # Errors
    /// As [`Self::pd`], and `ControlError::Gain` for other gains that are not finite or are negative.
    pub fn model_control(&self, law: Law, gains: ModelGains) -> Result<ModelControl, TaskError> {
        let pd = self.pd(Some(VehicleServo { kp: gains.kp, kd: gains.kd }))?;
        let reading = self.model_reading(&pd);
        let period = self.options().control_period();
        Ok(ModelControl::new(law, gains, reading, self.scene(), self.actions().clone(), period)?)
    }

    /// Model-predictive control: see [`Mpc`].
    ///
    /// # Errors
    /// As [`Self::pd`], and `ControlError::Gain` for a weight that is not finite or is negative.
    pub fn mpc(&self, gains: MpcGains) -> Result<Mpc, TaskError> {
        // Only what it reads counts of the PD.
        let pd = self.pd(Some(VehicleServo { kp: [0.0; 6], kd: [0.0; 6] }))?;
        let reading = self.model_reading(&pd);
        Ok(Mpc::new(gains, reading, self.scene(), self.actions().clone(), self.options().control_period())?)
    }

    /// [`Self::pd`] with an integral, whose gains follow from the others where `ki` does not give them: see [`Pid`].
    ///
    /// # Errors
    /// `TaskError` if there are no gains, or one is not finite or is negative.
    pub fn pid(&self, gains: Option<VehicleServo>, ki: Option<[f64; 6]>) -> Result<Pid, TaskError> {
        Ok(Pid::new(self.pd(gains)?, ki, self.options().control_period())?)
    }

    /// What a policy for this task says that it is for.
    pub fn policy_spec(&self) -> PolicySpec {
        PolicySpec {
            task: self.options().task.name().into(),
            scene: self.scene_name().into(),
            action: self.options().action,
            actions: self.action_len(),
            control_period: self.options().control_period(),
            observation: self.layout().blocks().iter().map(|block| (block.name.to_owned(), block.len())).collect(),
        }
    }
}

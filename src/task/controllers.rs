//! Controllers for a task.

use std::sync::Arc;

use super::definition::BaseController;
use super::ee_track::EETrack;
use super::registry::TaskKind;
use super::scene_task::Task;
use crate::control::{
    ActionKind, ActionMap, AdaptiveGains, AdaptiveMotionGains, BlockIndices, Controller, DockPd, DockPdGains,
    FeedbackGains, GainMap, LawGains, ModelBased, ModelIndices, MpcGains, NmpcGains, NoControl, ObservationIndices,
    ObserverGains, Pd, PdRestoring, Pid, PidGains, Plant, PolicySpec, ResolvedMotion, ResolvedMotionGains,
    TrackingIndices, TrackingNmpc, Widths, gain_names, merge,
};
use crate::description::VehicleServo;
use crate::error::TaskError;

/// Classical controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControllerKind {
    /// Zero action.
    None,
    /// PD station keeping.
    Pd,
    /// PD with compensation of weight and buoyancy.
    PdRestoring,
    /// PD with an integral.
    Pid,
    /// PD with a disturbance observer.
    Dob,
    /// PD with a bank of disturbance observers.
    DobAdaptive,
    /// Computed torque with a disturbance observer.
    ComputedTorque,
    /// Model-predictive control with a disturbance observer.
    Mpc,
    /// Nonlinear model-predictive control with a disturbance observer.
    Nmpc,
    /// Resolved motion of the end effector.
    ResolvedMotion,
    /// The same on a bank of models.
    ResolvedAdaptive,
    /// PD docking with a limited approach speed.
    DockPd,
}

impl ControllerKind {
    /// All kinds by name.
    pub const ALL: [(&'static str, Self); 12] = [
        ("none", Self::None),
        ("pd", Self::Pd),
        ("pd-restoring", Self::PdRestoring),
        ("pid", Self::Pid),
        ("dob", Self::Dob),
        ("dob-adaptive", Self::DobAdaptive),
        ("computed-torque", Self::ComputedTorque),
        ("mpc", Self::Mpc),
        ("nmpc", Self::Nmpc),
        ("resolved-motion", Self::ResolvedMotion),
        ("resolved-adaptive", Self::ResolvedAdaptive),
        ("dock-pd", Self::DockPd),
    ];

    /// Names of its gains.
    pub fn gain_names(self) -> Vec<String> {
        match self {
            Self::None => Vec::new(),
            Self::Pd | Self::PdRestoring => gain_names(&VehicleServo { kp: [0.0; 6], kd: [0.0; 6] }),
            Self::Pid => gain_names(&PidGains::default()),
            Self::Dob | Self::ComputedTorque => gain_names(&FeedbackGains::default()),
            Self::DobAdaptive => gain_names(&AdaptiveGains::default()),
            Self::Mpc => gain_names(&MpcGains::default()),
            Self::Nmpc => gain_names(&NmpcGains::default()),
            Self::ResolvedMotion => gain_names(&ResolvedMotionGains::default()),
            Self::ResolvedAdaptive => gain_names(&AdaptiveMotionGains::default()),
            Self::DockPd => gain_names(&DockPdGains::default()),
        }
    }
}

impl Task {
    /// A classical controller with these gains; defaults for those that are null or not given.
    ///
    /// Default gains: `kp` and `kd` of the scene (`vehicle.servo`), for computed torque over the diagonal of the nominal
    /// inertia at home; `ki` by [`PidGains::from_pd`]; the delay of the task's sensors (the maximum for banks of models), but
    /// for DOB and resolved motion, where `null` stands for it and the default is 0; the others by their structs.
    ///
    /// # Errors
    /// `TaskError` for a controller of another task, actions that are corrections to a controller, a gain that is
    /// unknown, misshaped, not finite or negative, or if there are no gains.
    pub fn controller(&self, kind: ControllerKind, given: &GainMap) -> Result<Arc<dyn Controller>, TaskError> {
        let (actions, period) = (self.actions().clone(), self.options().control_period());
        if kind == ControllerKind::None {
            // Without gains any is unknown.
            merge(&GainMap::new(), given)?;
            return Ok(Arc::new(self.no_control()));
        }
        self.refuse_residual()?;
        if kind == ControllerKind::ResolvedMotion {
            let gains = ResolvedMotionGains { delay: self.told_delay(given), ..ResolvedMotionGains::default() };
            return Ok(Arc::new(self.resolved_motion(merge(&gains, given)?)?));
        }
        if kind == ControllerKind::ResolvedAdaptive {
            let mut gains = AdaptiveMotionGains::default();
            [_, gains.motion.delay] = self.delays();
            return Ok(Arc::new(self.adaptive_motion(merge(&gains, given)?)?));
        }
        let tracks = self.options().task.base() == BaseController::ResolvedMotion;
        if kind == ControllerKind::Nmpc && tracks {
            let gains = merge(&NmpcGains::tracking(self.delay()), given)?;
            let indices = self.tracking_indices()?;
            return Ok(Arc::new(TrackingNmpc::new(self.scene(), indices, gains, actions, period)?));
        }
        if kind == ControllerKind::DockPd {
            let gains = merge(&DockPdGains::from_pd(self.servo(given)?), given)?;
            return Ok(Arc::new(DockPd::new(self.dock_indices()?, gains, actions)?));
        }
        let vehicle = self.vehicle_indices()?;
        let indices = self.model_indices(&vehicle);
        let scene = self.scene();
        Ok(match kind {
            ControllerKind::Pd => Arc::new(Pd::new(vehicle, merge(&self.servo(given)?, given)?, actions)?),
            ControllerKind::PdRestoring => {
                let pd = Pd::new(vehicle, merge(&self.servo(given)?, given)?, actions)?;
                Arc::new(PdRestoring::new(pd, indices, scene))
            }
            ControllerKind::Pid => {
                // The default integral gains follow from the others.
                let pd: GainMap =
                    given.iter().filter(|(name, _)| *name != "ki").map(|(n, v)| (n.clone(), v.clone())).collect();
                let gains = merge(&PidGains::from_pd(merge(&self.servo(given)?, &pd)?), given)?;
                Arc::new(Pid::new(vehicle, gains, actions, period)?)
            }
            ControllerKind::Dob => {
                let observer = ObserverGains { delay: self.told_delay(given), ..ObserverGains::default() };
                let gains = merge(&FeedbackGains::new(self.servo(given)?, observer), given)?;
                Arc::new(ModelBased::new(LawGains::Dob(gains), indices, scene, actions, period)?)
            }
            ControllerKind::DobAdaptive => {
                let [_, delay] = self.delays();
                let gains = merge(&AdaptiveGains::new(self.servo(given)?, delay), given)?;
                Arc::new(ModelBased::new(LawGains::Adaptive(gains), indices, scene, actions, period)?)
            }
            ControllerKind::ComputedTorque => {
                let mut servo = self.servo(given)?;
                let inertia = Plant::new(scene).inertia(&self.model().home);
                for gains in [&mut servo.kp, &mut servo.kd] {
                    gains.iter_mut().enumerate().for_each(|(k, gain)| *gain /= inertia[(k, k)]);
                }
                let gains = merge(&FeedbackGains::new(servo, ObserverGains::filtering(self.delay())), given)?;
                Arc::new(ModelBased::new(LawGains::ComputedTorque(gains), indices, scene, actions, period)?)
            }
            ControllerKind::Mpc => {
                let gains = merge(&MpcGains::new(ObserverGains::filtering(self.delay())), given)?;
                Arc::new(ModelBased::new(LawGains::Mpc(gains), indices, scene, actions, period)?)
            }
            ControllerKind::Nmpc => {
                let gains = merge(&NmpcGains::station_keeping(self.delay()), given)?;
                Arc::new(ModelBased::new(LawGains::Nmpc(gains), indices, scene, actions, period)?)
            }
            ControllerKind::None
            | ControllerKind::ResolvedMotion
            | ControllerKind::ResolvedAdaptive
            | ControllerKind::DockPd => unreachable!("returned above"),
        })
    }

    /// Zero actions.
    pub fn no_control(&self) -> NoControl {
        NoControl::new(Widths { observation: self.observation_len(), memory: 0, action: self.action_len() })
    }

    /// The paper's PD for this task, with these gains or the scene's own (`vehicle.servo`).
    ///
    /// # Errors
    /// `TaskError` if there are no gains, or one is not finite or is negative.
    pub fn pd(&self, gains: Option<VehicleServo>) -> Result<Pd, TaskError> {
        self.refuse_residual()?;
        let gains = gains.map_or_else(|| self.servo(&GainMap::new()), Ok)?;
        Ok(Pd::new(self.vehicle_indices()?, gains, self.actions().clone())?)
    }

    /// The controller that actions correct, if they do: the PD with the scene's gains, or resolved motion.
    ///
    /// # Errors
    /// `TaskError` where there is no such controller.
    pub fn base(&self) -> Result<Option<Arc<dyn Controller>>, TaskError> {
        if self.options().action != ActionKind::Residual {
            return Ok(None);
        }
        Ok(Some(match self.options().task.base() {
            BaseController::Pd => {
                let indices = self.vehicle_indices()?;
                Arc::new(Pd::new(indices, self.servo(&GainMap::new())?, self.actions().clone())?)
            }
            BaseController::ResolvedMotion => Arc::new(self.resolved_motion(ResolvedMotionGains::default())?),
            BaseController::DockPd => {
                let gains = DockPdGains::from_pd(self.servo(&GainMap::new())?);
                Arc::new(DockPd::new(self.dock_indices()?, gains, self.actions().clone())?)
            }
        }))
    }

    /// Delay of the task's sensors where it is given as `null`, else 0.
    fn told_delay(&self, given: &GainMap) -> usize {
        if given.get("delay").is_some_and(serde_json::Value::is_null) { self.delay() } else { 0 }
    }

    /// Minimum and maximum age of the sensors' measurements, control periods.
    pub fn delays(&self) -> [usize; 2] {
        self.disturbance().delay_range(self.options().control_period())
    }

    /// Age of the sensors' measurements, control periods: the middle of its range.
    pub fn delay(&self) -> usize {
        self.disturbance().delay.as_ref().map_or(0, |delay| delay.in_periods(self.options().control_period(), 0.5))
    }

    /// Environment of a policy for this task.
    pub fn policy_spec(&self) -> PolicySpec {
        PolicySpec {
            task: self.options().task.environment().into(),
            scene: self.scene_name().into(),
            action: self.options().action,
            actions: self.action_len(),
            control_period: self.options().control_period(),
            observation: self.layout().blocks().iter().map(|block| (block.name.to_owned(), block.len())).collect(),
        }
    }

    /// Error of a controller that does not fit this task.
    fn unfit(&self, reason: &str) -> TaskError {
        TaskError::Scene { scene: self.scene_name().to_owned(), reason: reason.to_owned() }
    }

    fn actions(&self) -> &ActionMap {
        &self.model().actions
    }

    /// Refuses controllers where actions are corrections to one.
    fn refuse_residual(&self) -> Result<(), TaskError> {
        match self.options().action {
            ActionKind::Residual => {
                Err(self.unfit("its actions are corrections to a controller: use NoControl for that alone"))
            }
            _ => Ok(()),
        }
    }

    /// The scene's PD gains; 0 where both are given.
    fn servo(&self, given: &GainMap) -> Result<VehicleServo, TaskError> {
        let is_given = |name| given.get(name).is_some_and(|value| !value.is_null());
        match &self.scene().vehicle.servo {
            Some(servo) => Ok(servo.clone()),
            None if is_given("kp") && is_given("kd") => Ok(VehicleServo { kp: [0.0; 6], kd: [0.0; 6] }),
            None => Err(self.unfit("it gives no gains (vehicle.servo) for the PD")),
        }
    }

    fn resolved_motion(&self, gains: ResolvedMotionGains) -> Result<ResolvedMotion, TaskError> {
        let (indices, period) = (self.tracking_indices()?, self.options().control_period());
        Ok(ResolvedMotion::new(self.scene(), indices, gains, self.actions().clone(), period)?)
    }

    fn adaptive_motion(&self, gains: AdaptiveMotionGains) -> Result<ResolvedMotion, TaskError> {
        let (indices, period) = (self.tracking_indices()?, self.options().control_period());
        Ok(ResolvedMotion::adaptive(self.scene(), indices, gains, self.actions().clone(), period)?)
    }

    fn tracking_indices(&self) -> Result<TrackingIndices, TaskError> {
        let TaskKind::EETrack(EETrack { preview, .. }) = &self.options().task else {
            return Err(self.unfit("resolved motion needs an end effector that follows a path: use the PD"));
        };
        let block = |names: &[&str]| self.block_indices(names);
        let spacing = preview.spacing;
        let ahead = self
            .layout()
            .block("preview")
            .filter(|_| spacing > 0.0)
            .map(|block| (BlockIndices { offset: block.offset, scale: block.scale.clone() }, spacing));
        Ok(TrackingIndices {
            width: self.observation_len(),
            error: block(&["position_error", "attitude_error"]),
            twist: block(&["linear_velocity", "angular_velocity"]),
            up: block(&["up"]),
            q: block(&["joint_position"]),
            qd: block(&["joint_rate"]),
            reference: block(&["reference_twist"]),
            ahead,
        })
    }

    /// Indices of consecutive blocks.
    fn block_indices(&self, names: &[&str]) -> BlockIndices {
        let mut blocks = names.iter().filter_map(|name| self.layout().block(name));
        let first = blocks
            .next()
            .map_or_else(BlockIndices::default, |b| BlockIndices { offset: b.offset, scale: b.scale.clone() });
        blocks.fold(first, |mut indices, block| {
            indices.scale.extend(&block.scale);
            indices
        })
    }

    fn vehicle_indices(&self) -> Result<ObservationIndices, TaskError> {
        match self.options().task.base() {
            BaseController::Pd => Ok(self.feedback_indices(["linear_velocity", "angular_velocity"])),
            BaseController::ResolvedMotion => {
                Err(self.unfit("the PD keeps station: use resolved motion for an end effector that follows a path"))
            }
            BaseController::DockPd => Err(self.unfit("the PD keeps station: use the docking PD for a dock")),
        }
    }

    fn dock_indices(&self) -> Result<ObservationIndices, TaskError> {
        if self.options().task.base() != BaseController::DockPd {
            return Err(self.unfit("the docking PD needs a dock: use the PD or resolved motion"));
        }
        Ok(self.feedback_indices(["relative_velocity", "relative_angular_velocity"]))
    }

    fn feedback_indices(&self, twist: [&str; 2]) -> ObservationIndices {
        let six = |names: [&str; 2]| {
            let mut found = names
                .into_iter()
                .filter_map(|name| self.layout().block(name))
                .flat_map(|block| block.scale.iter().enumerate().map(|(k, scale)| (block.offset + k, *scale)));
            std::array::from_fn(|_| found.next().expect("the layout of the task holds these two blocks of three"))
        };
        ObservationIndices {
            width: self.observation_len(),
            error: six(["position_error", "attitude_error"]),
            twist: six(twist),
        }
    }

    fn model_indices(&self, vehicle: &ObservationIndices) -> ModelIndices {
        ModelIndices {
            vehicle: vehicle.clone(),
            arm: [self.block_indices(&["joint_position"]), self.block_indices(&["joint_rate"])],
            reference: [self.block_indices(&["joint_reference"]), self.block_indices(&["joint_reference_rate"])],
            home: self.model().home[..self.joint_count()].to_vec(),
        }
    }
}

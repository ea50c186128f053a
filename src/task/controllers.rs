//! Controllers for a task.

use std::sync::Arc;

use serde::Serialize;

use super::definition::BaseController;
use super::ee_track::EETrack;
use super::registry::TaskKind;
use super::scene_task::Task;
use crate::control::{
    ActionKind, ActionMap, AdaptiveGains, AdaptiveMotionGains, BlockIndices, Controller, DockPd, DockPdGains,
    FeedbackGains, GainMap, LawGains, ModelBased, ModelIndices, MpcGains, NmpcGains, NoControl, NominalModel,
    ObservationIndices, ObserverGains, Pd, PdRestoring, Pid, PidGains, PolicySpec, ResolvedMotion, ResolvedMotionGains,
    TrackingIndices, TrackingNmpc, Widths, gain_names, merge,
};
use crate::description::VehicleServo;
use crate::error::TaskError;

/// A controller, or the reason why it does not fit the task.
type Made = Result<Arc<dyn Controller>, TaskError>;

/// Classical controller: its gains, and how a task makes it.
#[derive(Debug, Clone, Copy)]
pub struct ControllerKind {
    gain_names: fn() -> Vec<String>,
    make: fn(&Task, &GainMap) -> Made,
}

const fn kind<G: Default + Serialize>(make: fn(&Task, &GainMap) -> Made) -> ControllerKind {
    ControllerKind { gain_names: || gain_names(&G::default()), make }
}

impl ControllerKind {
    /// All kinds by name.
    pub const ALL: [(&'static str, Self); 12] = [
        ("none", kind::<GainMap>(Task::none)),
        ("pd", kind::<VehicleServo>(Task::pd)),
        ("pd-restoring", kind::<VehicleServo>(Task::pd_restoring)),
        ("pid", kind::<PidGains>(Task::pid)),
        ("dob", kind::<FeedbackGains>(Task::dob)),
        ("dob-adaptive", kind::<AdaptiveGains>(Task::adaptive_dob)),
        ("computed-torque", kind::<FeedbackGains>(Task::computed_torque)),
        ("mpc", kind::<MpcGains>(Task::mpc)),
        ("nmpc", kind::<NmpcGains>(Task::nmpc)),
        ("resolved-motion", kind::<ResolvedMotionGains>(Task::resolved_motion)),
        ("resolved-adaptive", kind::<AdaptiveMotionGains>(Task::adaptive_motion)),
        ("dock-pd", kind::<DockPdGains>(Task::dock_pd)),
    ];

    /// The kind of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|(known, _)| *known == name).map(|(_, kind)| kind)
    }

    /// Names of its gains.
    pub fn gain_names(self) -> Vec<String> {
        (self.gain_names)()
    }
}

impl Task {
    /// A classical controller with these gains; defaults where one is null or missing.
    ///
    /// Default gains: `kp` and `kd` of the scene (`vehicle.servo`), for computed torque divided by the diagonal of the nominal
    /// inertia at home; `ki` by [`PidGains::from_pd`]; the delay of the task's sensors (the maximum for banks of models), except
    /// for DOB and resolved motion, where `null` stands for it and the default is 0; the others by their structs.
    ///
    /// # Errors
    /// `TaskError` for a controller of another task, actions that are corrections to a controller, a gain that is
    /// unknown, misshaped, not finite or negative, or if there are no gains.
    pub fn controller(&self, kind: ControllerKind, given: &GainMap) -> Made {
        (kind.make)(self, given)
    }

    /// Without gains any is unknown.
    fn none(&self, given: &GainMap) -> Made {
        merge(&GainMap::new(), given)?;
        Ok(Arc::new(NoControl::new(Widths {
            observation: self.observation_len(),
            memory: 0,
            action: self.action_len(),
        })))
    }

    fn pd(&self, given: &GainMap) -> Made {
        Ok(Arc::new(self.feedback(given)?))
    }

    /// A PD with the scene's gains where none are given.
    fn feedback(&self, given: &GainMap) -> Result<Pd, TaskError> {
        Ok(Pd::new(self.vehicle_indices()?, merge(&self.servo(given)?, given)?, self.direct_actions()?)?)
    }

    fn pd_restoring(&self, given: &GainMap) -> Made {
        let pd = self.feedback(given)?;
        let indices = self.model_indices(pd.indices());
        Ok(Arc::new(PdRestoring::new(pd, indices, self.scene())))
    }

    fn pid(&self, given: &GainMap) -> Made {
        // The default integral gains follow from the others.
        let mut pd = given.clone();
        pd.retain(|name, _| name != "ki");
        let gains = merge(&PidGains::from_pd(merge(&self.servo(given)?, &pd)?), given)?;
        Ok(Arc::new(Pid::new(self.vehicle_indices()?, gains, self.direct_actions()?, self.period())?))
    }

    fn dob(&self, given: &GainMap) -> Made {
        let observer = ObserverGains { delay: self.known_delay(given), ..ObserverGains::default() };
        self.model_based(LawGains::Dob(merge(&FeedbackGains::new(self.servo(given)?, observer), given)?))
    }

    fn adaptive_dob(&self, given: &GainMap) -> Made {
        let [_, delay] = self.delays();
        self.model_based(LawGains::Adaptive(merge(&AdaptiveGains::new(self.servo(given)?, delay), given)?))
    }

    fn computed_torque(&self, given: &GainMap) -> Made {
        let mut servo = self.servo(given)?;
        let inertia = NominalModel::new(self.scene()).inertia(&self.model().home);
        for gains in [&mut servo.kp, &mut servo.kd] {
            gains.iter_mut().enumerate().for_each(|(k, gain)| *gain /= inertia[(k, k)]);
        }
        let gains = FeedbackGains::new(servo, ObserverGains::filtering(self.delay()));
        self.model_based(LawGains::ComputedTorque(merge(&gains, given)?))
    }

    fn mpc(&self, given: &GainMap) -> Made {
        self.model_based(LawGains::Mpc(merge(&MpcGains::new(ObserverGains::filtering(self.delay())), given)?))
    }

    fn nmpc(&self, given: &GainMap) -> Made {
        if self.options().task.base() != BaseController::ResolvedMotion {
            return self.model_based(LawGains::Nmpc(merge(&NmpcGains::station_keeping(self.delay()), given)?));
        }
        let gains = merge(&NmpcGains::tracking(self.delay()), given)?;
        let (indices, actions) = (self.tracking_indices()?, self.direct_actions()?);
        Ok(Arc::new(TrackingNmpc::new(self.scene(), indices, gains, actions, self.period())?))
    }

    fn model_based(&self, gains: LawGains) -> Made {
        let indices = self.model_indices(&self.vehicle_indices()?);
        Ok(Arc::new(ModelBased::new(gains, indices, self.scene(), self.direct_actions()?, self.period())?))
    }

    fn resolved_motion(&self, given: &GainMap) -> Made {
        let gains = ResolvedMotionGains { delay: self.known_delay(given), ..ResolvedMotionGains::default() };
        self.resolved(merge(&gains, given)?, self.direct_actions()?)
    }

    fn resolved(&self, gains: ResolvedMotionGains, actions: ActionMap) -> Made {
        let indices = self.tracking_indices()?;
        Ok(Arc::new(ResolvedMotion::new(self.scene(), indices, gains, actions, self.period())?))
    }

    fn adaptive_motion(&self, given: &GainMap) -> Made {
        let mut gains = AdaptiveMotionGains::default();
        [_, gains.motion.delay] = self.delays();
        let (indices, actions) = (self.tracking_indices()?, self.direct_actions()?);
        let gains = merge(&gains, given)?;
        Ok(Arc::new(ResolvedMotion::adaptive(self.scene(), indices, gains, actions, self.period())?))
    }

    fn dock_pd(&self, given: &GainMap) -> Made {
        let gains = merge(&DockPdGains::from_pd(self.servo(given)?), given)?;
        Ok(Arc::new(DockPd::new(self.dock_indices()?, gains, self.direct_actions()?)?))
    }

    /// The controller that actions correct, if they do: the PD with the scene's gains, or resolved motion.
    ///
    /// # Errors
    /// `TaskError` where there is no such controller.
    pub fn base(&self) -> Result<Option<Arc<dyn Controller>>, TaskError> {
        if self.options().action != ActionKind::Residual {
            return Ok(None);
        }
        let (actions, none) = (self.model().actions.clone(), GainMap::new());
        Ok(Some(match self.options().task.base() {
            BaseController::Pd => Arc::new(Pd::new(self.vehicle_indices()?, self.servo(&none)?, actions)?),
            BaseController::ResolvedMotion => self.resolved(ResolvedMotionGains::default(), actions)?,
            BaseController::DockPd => {
                Arc::new(DockPd::new(self.dock_indices()?, DockPdGains::from_pd(self.servo(&none)?), actions)?)
            }
        }))
    }

    fn period(&self) -> f64 {
        self.options().control_period()
    }

    /// Delay of the task's sensors where it is given as `null`, else 0.
    fn known_delay(&self, given: &GainMap) -> usize {
        if given.get("delay").is_some_and(serde_json::Value::is_null) { self.delay() } else { 0 }
    }

    /// Minimum and maximum age of the sensors' measurements, control periods.
    pub fn delays(&self) -> [usize; 2] {
        self.disturbance().delay_range(self.period())
    }

    /// Age of the sensors' measurements, control periods: the middle of its range.
    pub fn delay(&self) -> usize {
        self.disturbance().delay.as_ref().map_or(0, |delay| delay.in_periods(self.period(), 0.5))
    }

    /// Environment of a policy for this task.
    pub fn policy_spec(&self) -> PolicySpec {
        PolicySpec {
            task: self.options().task.environment().into(),
            scene: self.scene().name.clone(),
            action: self.options().action,
            actions: self.action_len(),
            control_period: self.period(),
            observation: self
                .layout()
                .blocks()
                .iter()
                .map(|block| (block.name.to_owned(), block.scale.len()))
                .collect(),
        }
    }

    /// Error of a controller that does not fit this task.
    fn unfit(&self, reason: &str) -> TaskError {
        TaskError::Scene { scene: self.scene().name.clone(), reason: reason.to_owned() }
    }

    /// Actions of a controller; none where actions are corrections to one.
    fn direct_actions(&self) -> Result<ActionMap, TaskError> {
        match self.options().action {
            ActionKind::Residual => {
                Err(self
                    .unfit("its actions are corrections to a controller: use NoControl for the controller by itself"))
            }
            _ => Ok(self.model().actions.clone()),
        }
    }

    /// The scene's PD gains; 0 where both are given.
    fn servo(&self, given: &GainMap) -> Result<VehicleServo, TaskError> {
        let is_given = |name| given.get(name).is_some_and(|value| !value.is_null());
        match &self.scene().vehicle.servo {
            Some(servo) => Ok(servo.clone()),
            None if is_given("kp") && is_given("kd") => Ok(VehicleServo::default()),
            None => Err(self.unfit("it gives no gains (vehicle.servo) for the PD")),
        }
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

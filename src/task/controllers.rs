//! Controllers for a task.

use std::sync::Arc;

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::definition::BaseController;
use super::ee_track::EETrack;
use super::registry::TaskKind;
use super::scene_task::Task;
use crate::control::{
    ActionKind, ActionMap, AdaptiveGains, AdaptiveMotionGains, BlockIndices, Controller, DockPdGains, FaultGains,
    FaultTolerant, FeedbackGains, GainMap, Guard, LawGains, MAX_DELAY, MAX_SENSOR_DELAY, ModelBased, ModelIndices,
    MpcGains, NmpcGains, NoControl, NominalModel, ObservationIndices, ObserverGains, Pd, PdRestoring, Pid, PidGains,
    Plant, PolicySpec, ResolvedMotion, ResolvedMotionGains, TrackingIndices, TrackingNmpc, Widths, gain_names, merge,
    to_map,
};
use crate::description::{Arm, DEFAULT_END_EFFECTOR, VehicleServo};
use crate::error::TaskError;

/// A controller and its gains, or the reason why it does not fit the task.
type Made = Result<(Arc<dyn Controller>, GainMap), TaskError>;

/// A controller and its gains.
fn made(controller: impl Controller + 'static, gains: &impl Serialize) -> Made {
    Ok((Arc::new(controller), to_map(gains)))
}

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
        ("dob", kind::<FaultTolerant<FeedbackGains>>(Task::dob)),
        ("dob-adaptive", kind::<AdaptiveGains>(Task::adaptive_dob)),
        ("computed-torque", kind::<FeedbackGains>(Task::computed_torque)),
        ("mpc", kind::<FaultTolerant<MpcGains>>(Task::mpc)),
        ("nmpc", kind::<FaultTolerant<NmpcGains>>(Task::nmpc)),
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
    /// A classical controller with these gains, and all its gains; defaults where one is null or missing.
    ///
    /// Default gains: `kp` and `kd` of the scene (`vehicle.servo`), for computed torque divided by the diagonal of the nominal
    /// inertia at home; `ki` by [`PidGains::from_pd`]; the delay of the task's sensors (the maximum for banks of models), except
    /// for DOB and resolved motion, where `null` stands for it and the default is 0; the others by their structs.
    ///
    /// # Errors
    /// `TaskError` for a controller of another task, actions that are corrections to a controller, a gain that is
    /// unknown, misshaped, not finite or out of its range, or if there are no gains.
    pub fn controller(&self, kind: ControllerKind, given: &GainMap) -> Made {
        (kind.make)(self, given)
    }

    /// Guard of a blend of controllers, which hands over between these measured pose errors, m.
    ///
    /// # Errors
    /// `TaskError` for a task without pose error in its observation, or errors out of order.
    pub fn guard(&self, range: [f64; 2]) -> Result<Guard, TaskError> {
        let error = self.block_indices(&["position_error", "attitude_error"]);
        if error.scale.len() != 6 {
            return Err(self.unfit("a guard needs the pose error in the observation"));
        }
        Ok(Guard::new(error, range)?)
    }

    /// Without gains any is unknown.
    fn none(&self, given: &GainMap) -> Made {
        let gains = merge(&GainMap::new(), given, 0)?;
        let widths = Widths { observation: self.observation_len(), memory: 0, action: self.action_len() };
        made(NoControl::new(widths), &gains)
    }

    fn pd(&self, given: &GainMap) -> Made {
        let (pd, gains) = self.feedback(given)?;
        made(pd, &gains)
    }

    /// A PD with the scene's gains where none are given.
    fn feedback(&self, given: &GainMap) -> Result<(Pd, VehicleServo), TaskError> {
        let (indices, gains) = (self.vehicle_indices()?, merge(&self.servo(given)?, given, 0)?);
        Ok((Pd::new(indices, gains.clone(), self.direct_actions()?), gains))
    }

    fn pd_restoring(&self, given: &GainMap) -> Made {
        let (pd, gains) = self.feedback(given)?;
        made(PdRestoring::new(pd, self.model_indices()?, self.scene()), &gains)
    }

    fn pid(&self, given: &GainMap) -> Made {
        // The default integral gains follow from the others.
        let mut pd = given.clone();
        pd.retain(|name, _| name != "ki");
        let gains = merge(&PidGains::from_pd(merge(&self.servo(given)?, &pd, 0)?), given, 0)?;
        made(Pid::new(self.vehicle_indices()?, gains.clone(), self.direct_actions()?, self.period()), &gains)
    }

    fn dob(&self, given: &GainMap) -> Made {
        let observer = ObserverGains { delay: self.known_delay(given), ..ObserverGains::default() };
        self.fault_tolerant(FeedbackGains::new(self.servo(given)?, observer), given, MAX_SENSOR_DELAY, LawGains::Dob)
    }

    fn adaptive_dob(&self, given: &GainMap) -> Made {
        let [_, delay] = self.delays();
        self.model_based(AdaptiveGains::new(self.servo(given)?, delay), given, MAX_DELAY, LawGains::Adaptive)
    }

    fn computed_torque(&self, given: &GainMap) -> Made {
        let mut servo = self.servo(given)?;
        let inertia = NominalModel::new(self.scene()).inertia(&self.model().home);
        for gains in [&mut servo.kp, &mut servo.kd] {
            gains.iter_mut().enumerate().for_each(|(k, gain)| *gain /= inertia[(k, k)]);
        }
        let gains = FeedbackGains::new(servo, ObserverGains::filtering(self.delay()));
        self.model_based(gains, given, MAX_SENSOR_DELAY, LawGains::ComputedTorque)
    }

    fn mpc(&self, given: &GainMap) -> Made {
        let gains = MpcGains::new(ObserverGains::filtering(self.delay()));
        self.fault_tolerant(gains, given, MAX_SENSOR_DELAY, LawGains::Mpc)
    }

    fn nmpc(&self, given: &GainMap) -> Made {
        if self.options().task.base() != BaseController::ResolvedMotion {
            return self.fault_tolerant(NmpcGains::station_keeping(self.delay()), given, MAX_DELAY, LawGains::Nmpc);
        }
        let gains = merge(&NmpcGains::tracking(self.delay()), given, MAX_DELAY)?;
        made(TrackingNmpc::new(&gains, self.tracking_indices()?, self.plant()?), &gains)
    }

    fn model_based<G>(&self, gains: G, given: &GainMap, max_delay: usize, law: fn(G) -> LawGains) -> Made
    where
        G: Clone + Serialize + DeserializeOwned,
    {
        let gains = merge(&gains, given, max_delay)?;
        let controller =
            ModelBased::new(law(gains.clone()), FaultGains::default(), self.model_indices()?, self.plant()?)?;
        made(controller, &gains)
    }

    /// A control law that may look for a lost thruster.
    fn fault_tolerant<G>(&self, gains: G, given: &GainMap, max_delay: usize, law: fn(G) -> LawGains) -> Made
    where
        G: Clone + Serialize + DeserializeOwned,
    {
        let gains = merge(&FaultTolerant::new(gains), given, max_delay)?;
        let (law, fault) = (law(gains.law.clone()), gains.fault);
        made(ModelBased::new(law, fault, self.model_indices()?, self.plant()?)?, &gains)
    }

    fn resolved_motion(&self, given: &GainMap) -> Made {
        let gains = ResolvedMotionGains { delay: self.known_delay(given), ..ResolvedMotionGains::default() };
        let gains = merge(&gains, given, MAX_DELAY)?;
        made(ResolvedMotion::new(gains.clone(), self.tracking_indices()?, self.plant()?)?, &gains)
    }

    fn adaptive_motion(&self, given: &GainMap) -> Made {
        let mut gains = AdaptiveMotionGains::default();
        [_, gains.motion.delay] = self.delays();
        let gains = merge(&gains, given, MAX_DELAY)?;
        made(ResolvedMotion::adaptive(&gains, self.tracking_indices()?, self.plant()?)?, &gains)
    }

    fn docking_gains(&self, servo: VehicleServo) -> DockPdGains {
        let gains = DockPdGains::from_pd(servo);
        match &self.options().task {
            TaskKind::Dock(dock) if dock.touches() => gains.onto_cradle(),
            _ => gains,
        }
    }

    fn dock_pd(&self, given: &GainMap) -> Made {
        let gains = merge(&self.docking_gains(self.servo(given)?), given, 0)?;
        made(Pd::docking(self.dock_indices()?, gains.clone(), self.direct_actions()?), &gains)
    }

    /// The controller that actions correct, if they do: the PD with the scene's gains, or resolved motion.
    ///
    /// # Errors
    /// `TaskError` where there is no such controller.
    pub fn base(&self) -> Result<Option<Arc<dyn Controller>>, TaskError> {
        if self.options().action != ActionKind::Residual {
            return Ok(None);
        }
        let (actions, servo) = (self.model().actions.clone(), self.servo(&GainMap::new()));
        Ok(Some(match self.options().task.base() {
            BaseController::Pd => Arc::new(Pd::new(self.vehicle_indices()?, servo?, actions)),
            BaseController::DockPd => Arc::new(Pd::docking(self.dock_indices()?, self.docking_gains(servo?), actions)),
            BaseController::ResolvedMotion => {
                let plant = Plant { scene: self.scene(), actions, period: self.period() };
                Arc::new(ResolvedMotion::new(ResolvedMotionGains::default(), self.tracking_indices()?, plant)?)
            }
        }))
    }

    /// Vehicle and arm under a controller.
    fn plant(&self) -> Result<Plant<'_>, TaskError> {
        Ok(Plant { scene: self.scene(), actions: self.direct_actions()?, period: self.period() })
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
            end_effector: self.scene().arm.as_ref().map_or(DEFAULT_END_EFFECTOR, Arm::end_effector_name).to_owned(),
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
        if self.options().task.base() != BaseController::ResolvedMotion {
            return Err(self.unfit("resolved motion needs an end effector that follows a path: use the PD"));
        }
        let spacing = match &self.options().task {
            TaskKind::EETrack(EETrack { preview, .. }) => preview.spacing,
            _ => 0.0,
        };
        let previewed = spacing > 0.0 && self.layout().block("preview").is_some();
        let ObservationIndices { width, error, twist } = self.feedback_indices(["linear_velocity", "angular_velocity"]);
        Ok(TrackingIndices {
            width,
            error,
            twist,
            up: self.block_indices(&["up"]),
            q: self.block_indices(&["joint_position"]),
            qd: self.block_indices(&["joint_rate"]),
            reference: self.block_indices(&["reference_twist"]),
            ahead: previewed.then(|| (self.block_indices(&["preview"]), spacing)),
        })
    }

    /// Indices of consecutive blocks.
    fn block_indices(&self, names: &[&str]) -> BlockIndices {
        let blocks: Vec<_> = names.iter().filter_map(|name| self.layout().block(name)).collect();
        let scale = blocks.iter().flat_map(|block| block.scale.iter().copied()).collect();
        BlockIndices { offset: blocks.first().map_or(0, |block| block.offset), scale }
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
        let error = self.block_indices(&["position_error", "attitude_error"]);
        ObservationIndices { width: self.observation_len(), error, twist: self.block_indices(&twist) }
    }

    fn model_indices(&self) -> Result<ModelIndices, TaskError> {
        Ok(ModelIndices {
            vehicle: self.vehicle_indices()?,
            arm: [self.block_indices(&["joint_position"]), self.block_indices(&["joint_rate"])],
            reference: [self.block_indices(&["joint_reference"]), self.block_indices(&["joint_reference_rate"])],
            home: self.model().home[..self.joint_count()].to_vec(),
        })
    }
}

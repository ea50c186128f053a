//! Interface between a task and the kernel that all tasks share.

use std::fmt::Debug;

use nalgebra::Vector3;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::arm_reference;
use super::bounds::{POSITION_BOUND, shorter};
use super::disturbance::{DisturbanceKernel, MEASURED};
use super::episode::{EpisodeRows, RowAllocator, TaskRows};
use super::kernel::ActionKernel;
use super::metrics::{METRICS, Metrics, OWN_METRICS};
use super::model::TaskModel;
use super::observation::{ObservationLayout, ObservationWriter};
use super::options::TaskOptions;
use super::pose::{Pose, PoseError, StageState};
use super::random::Stream;
use super::reward::{COARSE, RewardKernel};
use crate::control::{ActionKind, Actuation};
use crate::description::Scene;
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows, Shared};
use crate::lie;
use crate::system::{EndEffector, JOINTS, State};

/// Frame whose pose error a task measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// The vehicle's.
    Vehicle,
    /// The end effector's.
    EndEffector,
}

/// Controller that residual actions of a task correct.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BaseController {
    /// The paper's PD.
    Pd,
    /// Resolved motion.
    ResolvedMotion,
    /// PD with a limited approach speed.
    DockPd,
}

/// A task: its options, memory, observation, references and metrics. The implementing type holds the task's own options.
///
/// The kernel ([`TaskKernel`]) is compiled once per task and precision. Methods over lanes must be `#[inline(always)]` and
/// free of closures, which would not inherit the instruction set; their results must depend on the instance's own rows only
/// and be finite for every state in bounds.
pub trait TaskDefinition:
    Clone + Debug + PartialEq + Default + Serialize + DeserializeOwned + Send + Sync + 'static
{
    /// Name among options, such as `"station-keep"`.
    const NAME: &'static str;
    /// Name of the environment without variant and version, such as `"UVMS-StationKeep"`.
    const ENVIRONMENT: &'static str;
    /// Frame whose pose error counts.
    const FRAME: Frame = Frame::Vehicle;
    /// Joints are driven by torques, the last entries of an action, rather than follow references under their servos.
    const DRIVES_JOINTS: bool = false;
    /// Driven joints keep the damping of their servos as friction, which keeps light joints from diverging; without it only joints
    /// without rotor inertia do.
    const KEEPS_SERVO_DAMPING: bool = true;
    /// The direction against gravity is measured and observed.
    const OBSERVES_UP: bool = false;
    /// Observation blocks of the measured twist, linear and angular: name and description.
    const TWIST: [(&'static str, &'static str); 2] = [
        ("linear_velocity", "absolute velocity of the vehicle origin, body axes"),
        ("angular_velocity", "absolute angular velocity, body axes"),
    ];
    /// Controller that residual actions correct.
    const BASE: BaseController = BaseController::Pd;
    /// Pose error at which the linear part of the reward's pose term is 1, m.
    const REWARD_SCALE: f64 = COARSE;
    /// Number of leading measured quantities that the task's own observation blocks depend on: gradients differentiate the blocks
    /// along each. Errors of position and attitude, twist, joint coordinates, joint rates, direction against gravity.
    const MEASURED_INPUTS: usize = MEASURED;
    /// Names of the task's own metrics, at most [`OWN_METRICS`].
    const METRICS: &'static [&'static str] = &[];

    /// The task's numbers in the precision of the lanes.
    type Kernel<T: Real>: Clone + Debug + PartialEq + Send + Sync;

    /// Default options that all tasks have; where they differ from the usual ones, the task overrides this.
    fn defaults() -> TaskOptions {
        TaskOptions::default()
    }

    /// Refuses the task's own options out of their ranges; `start_distance` is the shared one, m.
    ///
    /// # Errors
    /// `TaskError::Option`.
    fn check(&self, start_distance: f64) -> Result<(), TaskError>;

    /// Adds to the scene what the robot works on: by default nothing.
    ///
    /// # Errors
    /// `TaskError::Scene` for a scene that does not fit.
    fn place(&self, scene: Scene) -> Result<Scene, TaskError> {
        Ok(scene)
    }

    /// Appends the task's observation blocks, between the joint rates and the previous action: by default the joints' references.
    fn layout(&self, _options: &TaskOptions, model: &TaskModel, layout: &mut ObservationLayout) {
        arm_reference::push_blocks(model, layout);
    }

    /// Allocates the task's rows of an episode's memory: by default the joints' references.
    fn rows(&self, model: &TaskModel, rows: &mut RowAllocator) -> TaskRows {
        arm_reference::rows(model, rows)
    }

    /// The task's numbers in the precision of the lanes.
    fn kernel<T: Real>(&self, options: &TaskOptions, model: &TaskModel, rows: &EpisodeRows) -> Self::Kernel<T>;

    /// Draws the vehicle's pose at the start of an episode with that target: by default within a ball about it.
    fn start_pose(&self, options: &TaskOptions, _model: &TaskModel, target: &Pose, draw: &Stream) -> Pose {
        Pose {
            position: target.position + draw.unit_vector(0) * (options.start_distance * draw.uniform(1)),
            rotation: target.rotation
                * Pose::turn(draw.unit_vector(2) * (options.start_angle * draw.uniform(3))).rotation,
        }
    }

    /// Draws the references of an episode into its memory, whose target is set.
    fn sample(&self, kernel: &TaskKernel<f64, Self>, start: &EpisodeStart<'_>, memory: &mut Rows<'_, f64>);

    /// Sets the target and the references of the first control instant, at the start of an episode.
    #[inline(always)]
    fn begin<L: Lane>(kernel: &TaskKernel<L::Real, Self>, memory: &mut Rows<'_, L::Real>) {
        arm_reference::begin::<L, Self>(kernel, memory);
    }

    /// Moves the target and the references to the next control instant.
    #[inline(always)]
    fn advance<L: Lane>(kernel: &TaskKernel<L::Real, Self>, memory: &mut Rows<'_, L::Real>) {
        arm_reference::advance::<L, Self>(kernel, memory);
    }

    /// Measured twist in body axes: the absolute one by default.
    #[inline(always)]
    fn twist<L: Lane>(at: &ControlInstant<'_, L, Self>) -> lie::Vector6<L> {
        at.state.twist
    }

    /// Writes the entries of the blocks of [`Self::layout`]. `measured` is the sensors' reading.
    #[inline(always)]
    fn observe<L: Lane>(
        at: &ControlInstant<'_, L, Self>,
        _measured: &[L; MEASURED],
        writer: &mut ObservationWriter<'_, L::Real>,
    ) {
        arm_reference::observe(at, writer);
    }

    /// Instances whose position is within its bound, with the task's own conditions.
    #[inline(always)]
    fn in_bounds<L: Lane>(at: &ControlInstant<'_, L, Self>) -> L::Mask {
        shorter(at.error.position, POSITION_BOUND)
    }

    /// Updates the rows [`TaskRows::updated`] for a control instant and returns its own reward term; `metrics` belong to the
    /// instant. Not called for tasks without own metrics.
    #[inline(always)]
    fn update<L: Lane>(_at: &mut ControlInstant<'_, L, Self>, _metrics: &Metrics<L>) -> L {
        L::zero()
    }

    /// The task's own metrics from its memory, in the order of [`Self::METRICS`]; it may replace the shared `success`. Not
    /// called for tasks without own metrics.
    #[inline(always)]
    fn own_metrics<L: Lane>(_at: &ControlInstant<'_, L, Self>, _metrics: &mut Metrics<L>) -> [L; OWN_METRICS] {
        [L::zero(); OWN_METRICS]
    }

    /// Instances whose episode continues, among those in bounds: all by default.
    #[inline(always)]
    fn continues<L: Lane>(_kernel: &TaskKernel<L::Real, Self>, _metrics: &Metrics<L>, in_bounds: L::Mask) -> L::Mask {
        in_bounds
    }
}

/// A group of instances at a control instant, as the methods of a task read it.
pub struct ControlInstant<'a, L: Lane, K: TaskDefinition> {
    /// Numbers of the task.
    pub kernel: &'a TaskKernel<L::Real, K>,
    /// Memory of the episodes.
    pub memory: Rows<'a, L::Real>,
    /// State of the instances.
    pub state: &'a StageState<L>,
    /// Error of the task's frame from its target.
    pub error: PoseError<L>,
}

impl<'a, L: Lane, K: TaskDefinition> ControlInstant<'a, L, K> {
    /// Instances in this state, whose targets are in their memory.
    #[inline(always)]
    pub fn new(kernel: &'a TaskKernel<L::Real, K>, memory: Rows<'a, L::Real>, state: &'a StageState<L>) -> Self {
        let error = PoseError::of(&kernel.frame(state), &kernel.rows.target(&memory));
        Self { kernel, memory, state, error }
    }
}

/// The numbers of a task in the precision of the lanes.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskKernel<T, K: TaskDefinition>
where
    T: Real,
{
    pub(super) rows: EpisodeRows,
    pub(super) actuation: Actuation<T>,
    pub(super) end_effector: EndEffector<Shared<T>>,
    /// Control periods per second.
    pub(super) frequency: T,
    /// Decay of the pose error's integral over a control period, and its gain for an error constant over that.
    pub(super) leak: [T; 2],
    pub(super) home: [T; JOINTS],
    /// One over the scale, and the bound, of each entry of an observation.
    pub(super) scaling: Vec<[T; 2]>,
    pub(super) reward: RewardKernel<T>,
    /// One over the number of entries of an action.
    pub(super) per_entry: T,
    /// Errors of position (m) and attitude (rad) below which a pose counts as reached.
    pub(super) tolerance: [T; 2],
    /// Control period, s.
    pub(super) period: T,
    /// Maximum correction to the base controller's action, with residual actions.
    pub(super) residual: Option<T>,
    /// World axis against gravity.
    pub(super) up: [T; 3],
    pub(super) disturbance: Option<DisturbanceKernel<T>>,
    pub(super) task: K::Kernel<T>,
}

/// Leak of the integral of the pose error, 1/s: `I' = e - LEAK I`.
pub(super) const LEAK: f64 = 0.1;

impl<T: Real, K: TaskDefinition> TaskKernel<T, K> {
    /// Numbers of the task in this precision.
    pub(super) fn new(task: &K, options: &TaskOptions, model: &TaskModel) -> Self {
        const { assert!(K::METRICS.len() <= OWN_METRICS) };
        let (period, number) = (options.control_period(), T::from_f64);
        let (keep, actions) = ((-LEAK * period).exp(), model.actions.len());
        let rows = EpisodeRows::new(model, |rows| task.rows(model, rows));
        Self {
            disturbance: rows.disturbance.map(|rows| DisturbanceKernel::new(rows, &model.context)),
            actuation: Actuation::new(&model.actions),
            end_effector: model.end_effector.map(|Shared(x)| Shared(number(x))),
            frequency: number(1.0 / period),
            leak: [keep, (1.0 - keep) / LEAK].map(number),
            home: model.home.map(number),
            scaling: model.layout.scaling().map(|entry| entry.map(number)).collect(),
            reward: RewardKernel::new(&options.reward, actions, K::REWARD_SCALE),
            per_entry: number(1.0 / actions as f64),
            tolerance: [options.tolerance.position, options.tolerance.attitude].map(number),
            period: number(period),
            residual: (options.action == ActionKind::Residual).then(|| number(options.residual_scale)),
            up: model.up().map(number),
            task: task.kernel(options, model, &rows),
            rows,
        }
    }

    /// Rows of an episode's memory.
    pub fn rows(&self) -> &EpisodeRows {
        &self.rows
    }

    /// Kernel of actions.
    #[inline(always)]
    pub fn actions(&self) -> ActionKernel<'_, T> {
        let Self { rows, actuation, frequency, residual, .. } = self;
        let (disturbance, drives_joints) = (self.disturbance(), K::DRIVES_JOINTS);
        ActionKernel { rows, actuation, frequency: *frequency, residual: *residual, disturbance, drives_joints }
    }

    /// Disturbances that change within episodes, if any.
    #[inline(always)]
    pub fn disturbance(&self) -> Option<&DisturbanceKernel<T>> {
        self.disturbance.as_ref()
    }

    /// Entries of an observation.
    pub fn observation_len(&self) -> usize {
        self.scaling.len()
    }

    /// Names of the metrics: the shared ones, then the task's own.
    pub fn metric_names() -> Vec<&'static str> {
        Metrics::NAMES.iter().chain(K::METRICS).copied().collect()
    }

    /// Number of metrics.
    #[inline(always)]
    pub fn metrics() -> usize {
        METRICS + K::METRICS.len()
    }

    /// Pose of the task's frame.
    #[inline(always)]
    pub(super) fn frame<L: Lane<Real = T>>(&self, state: &StageState<L>) -> lie::Pose<L> {
        match K::FRAME {
            Frame::Vehicle => state.pose,
            Frame::EndEffector => state.pose.times(&self.end_effector.at(&state.q)),
        }
    }
}

/// Drawn start of an episode, for [`TaskDefinition::sample`].
pub struct EpisodeStart<'a> {
    /// Options of the task.
    pub options: &'a TaskOptions,
    /// The scene as the task reads it.
    pub model: &'a TaskModel,
    /// Target.
    pub target: Pose,
    /// Start state.
    pub state: &'a State,
    /// Factors on the arm's amplitude and speed.
    pub arm: [f64; 2],
    /// Stream of the references.
    pub draw: Stream,
}

impl EpisodeStart<'_> {
    /// Vertical, against gravity.
    pub(super) fn up(&self) -> &Vector3<f64> {
        &self.model.level[2]
    }
}

//! A task on a scene.

use std::sync::Arc;

use nalgebra::Vector3;

use super::definition::{TaskDefinition, TaskKernel};
use super::disturbance::{Column, Disturbance, DisturbanceContext, Profile};
use super::drives::{JointDrives, with_drives};
use super::episode::{Episode, EpisodeRows};
use super::gradient::TaskGradient;
use super::kernel::Command;
use super::metrics::Outcome;
use super::model::TaskModel;
use super::observation::ObservationLayout;
use super::observe::layout;
use super::options::TaskOptions;
use super::pose::{Pose, StageState};
use super::registry::dispatch_task;
use super::scalar::{Scalar, ScalarKernel};
use super::scene_draws::SceneDraws;
use crate::control::{ACTIONS, ActionKind, ActionMap, ActionRange, Allocation};
use crate::description::{Joint, Scene};
use crate::error::{ControlError, TaskError};
use crate::lane::Real;
use crate::system::{EndEffector, JOINTS, State};

/// Control periods of a usual episode: 20 s.
pub const DEFAULT_HORIZON: u32 = 400;

/// A task on one scene; the same for all instances and episodes.
///
/// An episode runs: [`Self::begin`]; then per control period [`Self::observe`], [`Self::act`], the physics with that
/// [`Command`], [`Self::advance`].
#[derive(Debug, Clone)]
pub struct Task {
    options: TaskOptions,
    given: Arc<Scene>,
    model: Arc<TaskModel>,
    thruster_names: Vec<String>,
    joint_names: Vec<String>,
    metric_names: Vec<&'static str>,
    kernel: Arc<dyn ScalarKernel>,
}

impl Task {
    /// The task on `scene`.
    ///
    /// # Errors
    /// `TaskError`: a vehicle that is fixed, has no thrusters or (for wrench actions) no axis they can push along, a
    /// joint without a servo, an unknown end effector, or an option out of its range.
    pub fn new(scene: &Scene, options: TaskOptions) -> Result<Self, TaskError> {
        options.check_all()?;
        let given = Arc::new(scene.clone());
        let scene = match &options.end_effector {
            Some(name) => scene.with_end_effector(name).map_err(|error| TaskError::Options(error.to_string()))?,
            None => scene.clone(),
        };
        dispatch_task!(&options.task, K, task => Self::with_definition::<K>(scene, task.clone(), options, given))
    }

    fn with_definition<K: TaskDefinition>(
        mut scene: Scene,
        task: K,
        options: TaskOptions,
        given: Arc<Scene>,
    ) -> Result<Self, TaskError> {
        if K::DRIVES_JOINTS {
            scene = with_drives(&scene, K::KEEPS_SERVO_DAMPING);
        }
        scene = task.place(scene)?;
        if let Some(lag) = options.thruster_lag {
            scene.vehicle.set_thruster_lag(lag);
        }
        let model = model(scene, &task, &options)?;
        let kernel = TaskKernel::new(&task, &options, &model);
        Ok(Self {
            thruster_names: model.scene.thruster_names(),
            joint_names: model.scene.joint_names(),
            metric_names: TaskKernel::<f64, K>::metric_names(),
            model: Arc::new(model),
            kernel: Arc::new(Scalar { task, kernel }),
            options,
            given,
        })
    }

    /// Disturbance of the episodes.
    pub fn disturbance(&self) -> &Disturbance {
        &self.model.disturbance
    }

    /// The scene as the task reads it.
    pub fn model(&self) -> &TaskModel {
        &self.model
    }

    /// Disturbance over the coming control periods of the episode, one entry each, for a vehicle at rest in `pose`.
    pub fn profile(&self, episode: &Episode, pose: &Pose, steps: u32) -> Profile {
        let (mut numbers, pose) = (episode.numbers().to_vec(), pose.in_lanes());
        let thrusters = self.model.context.thrusters;
        match self.kernel.disturbance() {
            Some(kernel) => kernel.profile(&mut numbers, episode.key(), episode.step(), steps, &pose, thrusters),
            None => Profile::steady(&episode.current(), steps, thrusters),
        }
    }

    /// Pose of the task's frame: the vehicle's or the end effector's.
    pub fn frame(&self, state: &State) -> Pose {
        self.kernel.frame(&self.model, state)
    }

    /// Options in use.
    pub fn options(&self) -> &TaskOptions {
        &self.options
    }

    /// The scene, with the task's changes.
    pub fn scene(&self) -> &Scene {
        &self.model.scene
    }

    /// The scene as it was given.
    pub fn given_scene(&self) -> &Scene {
        &self.given
    }

    /// Scenes of the episodes, where they differ.
    pub fn scene_draws(&self) -> Option<&SceneDraws> {
        self.model.scene_draws.as_ref()
    }

    /// Layout of an observation.
    pub fn layout(&self) -> &ObservationLayout {
        &self.model.layout
    }

    /// Entries of an observation.
    pub fn observation_len(&self) -> usize {
        self.model.layout.width()
    }

    /// Entries of an action.
    pub fn action_len(&self) -> usize {
        self.model.actions.len()
    }

    /// Meaning of each entry of an action.
    pub fn action_ranges(&self) -> Vec<ActionRange> {
        let actions = &self.model.actions;
        let mut ranges = actions.ranges(self.thruster_names.iter().map(String::as_str));
        for ((torque, name), joint) in actions.torques().iter().zip(&self.joint_names).zip(&self.model.joints) {
            let unit = if joint.slides() { "N" } else { "N m" };
            ranges.push(ActionRange {
                name: name.clone(),
                limits: [-torque, *torque],
                unit,
                description: "joint torque",
            });
        }
        if self.options.action == ActionKind::Residual {
            ranges
                .iter_mut()
                .for_each(|range| range.limits = range.limits.map(|limit| limit * self.options.residual_scale));
        }
        ranges
    }

    /// The thruster allocation.
    pub fn allocation(&self) -> &Allocation {
        self.model.actions.allocation()
    }

    /// Names of the metrics: the shared ones, then the task's own.
    pub fn metric_names(&self) -> &[&'static str] {
        &self.metric_names
    }

    /// Number of joint coordinates of the state: the robot's joints, then the fixtures.
    pub fn coordinate_count(&self) -> usize {
        self.model.scene.coordinates().count()
    }

    /// Number of joints.
    pub fn joint_count(&self) -> usize {
        self.model.joints.len()
    }

    /// Refuses actions (n rows) that are misshaped or not finite. Entries beyond [-1, 1] are clipped by [`Self::act`].
    ///
    /// # Errors
    /// `ControlError::Shape` or `TaskError::Action`, with the instance and the entry.
    pub fn check_actions(&self, actions: &[f32], n: usize) -> Result<(), TaskError> {
        let expected = n * self.action_len();
        if actions.len() != expected {
            return Err(ControlError::Shape { what: "actions", got: actions.len(), expected }.into());
        }
        // No early exit, so that the loop vectorises.
        if actions.iter().fold(true, |finite, a| finite & a.is_finite()) {
            return Ok(());
        }
        match actions.iter().position(|a| !a.is_finite()) {
            None => Ok(()),
            Some(at) => {
                let (instance, index) = (at / self.action_len(), at % self.action_len());
                Err(TaskError::Action { instance, index, value: actions[at] })
            }
        }
    }

    /// The kernel of the task of type `K` in this precision; `definition` is the options' task.
    pub fn in_lanes<T: Real, K: TaskDefinition>(&self, definition: &K) -> TaskKernel<T, K> {
        TaskKernel::new(definition, &self.options, &self.model)
    }

    /// The kernel for one instance.
    pub(super) fn kernel(&self) -> &dyn ScalarKernel {
        &*self.kernel
    }

    /// Rows of an episode's numbers.
    pub fn episode_rows(&self) -> EpisodeRows {
        *self.kernel.rows()
    }

    /// [`ActionKernel::act`](super::ActionKernel::act) for one instance.
    pub fn act(&self, episode: &mut Episode, action: &[f32]) -> Command<f64> {
        let mut entries = [0.0; ACTIONS];
        entries.iter_mut().zip(action).for_each(|(entry, a)| *entry = f64::from(*a));
        if let Some(disturbance) = self.kernel.disturbance() {
            let (key, step) = (episode.key(), episode.step());
            disturbance.advance(&mut Column::of_one(&mut episode.numbers), key, step);
        }
        self.kernel.act(&mut episode.memory(), &mut entries)
    }

    /// [`TaskKernel::advance`] and `ControlInstant::evaluate` for one instance.
    pub fn advance(&self, episode: &mut Episode, state: &State) -> Outcome {
        episode.step += 1;
        let share = 1.0 / f64::from(episode.step);
        self.kernel.advance(episode.memory(), &StageState::from(state), share)
    }

    /// `ControlInstant::observe` for one instance.
    pub fn observe(&self, episode: &Episode, state: &State, row: &mut [f32]) {
        self.kernel.observe(episode.clone().memory(), &StageState::from(state), row);
    }

    /// Gradients through its kernels.
    pub fn gradient(&self) -> &dyn TaskGradient {
        self.kernel.gradient()
    }
}

/// The scene as task `K` reads it.
fn model<K: TaskDefinition>(scene: Scene, task: &K, options: &TaskOptions) -> Result<TaskModel, TaskError> {
    let refuse = |reason: String| Err(TaskError::Scene { scene: scene.name.clone(), reason });
    let vehicle = &scene.vehicle;
    if vehicle.fixed {
        return refuse("its vehicle is fixed".into());
    }
    if vehicle.thrusters.is_empty() {
        return refuse("its vehicle has no thrusters".into());
    }
    let allocation = Allocation::new(vehicle)?;
    if options.action != ActionKind::Thrusters && allocation.unactuated().len() == 6 {
        let hint = "no axis of the wrench can be actuated alone (action \"thrusters\" may work)";
        return refuse(hint.into());
    }
    let joints: Vec<Joint> = scene.joints().cloned().collect();
    if joints.len() > JOINTS {
        return refuse(format!("it has {} joints, at most {JOINTS} are supported", joints.len()));
    }
    let mut named = joints.iter().zip(scene.joint_names());
    let follows = |joint: &Joint| joint.prescribed || joint.servo.is_some();
    match named.find(|(joint, _)| if K::DRIVES_JOINTS { joint.prescribed } else { !follows(joint) }) {
        Some((_, name)) if K::DRIVES_JOINTS => {
            return refuse(format!("joint \"{name}\" is prescribed, so torques cannot drive it"));
        }
        Some((_, name)) => return refuse(format!("joint \"{name}\" has no servo to follow its reference with")),
        None => {}
    }

    let up = (-scene.water.gravity).try_normalize(0.0).unwrap_or_else(Vector3::z);
    let forward = if up.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let forward = (forward - up * up.dot(&forward)).normalize();
    let level = [forward, up.cross(&forward), up];
    let context =
        DisturbanceContext::new(&scene, &allocation, level, options.control_period()).measuring_up(K::OBSERVES_UP);
    let disturbance = options.disturbance();
    if options.disturbance.is_some() || options.randomize.is_some() {
        disturbance.check(&context)?;
    }
    let drives = match K::DRIVES_JOINTS {
        true => JointDrives::new(&scene.robot(), &up, allocation.wrench_limits())?,
        false => JointDrives::default(),
    };
    let parameters = disturbance.parameters.as_ref();
    let scene_draws = parameters.map_or(Ok(None), |parameters| SceneDraws::new(&scene, parameters))?;
    let mut model = TaskModel {
        scene_draws,
        joints,
        home: scene.home(),
        end_effector: EndEffector::new(&scene),
        actions: ActionMap::new(options.action, allocation, drives.torques.clone()),
        drives,
        level,
        disturbance,
        context,
        layout: ObservationLayout::default(),
        scene,
    };
    model.layout = layout(task, options, &model);
    Ok(model)
}

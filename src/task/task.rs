//! A task on a scene. Station keeping: the vehicle holds a pose while the arm moves and a current pushes.

use nalgebra::Vector3;

use super::authority::{greatest_tilt, greatest_torques, with_drives};
use super::disturbance::{Column, Disturbance, Profile, Site};
use super::episode::{Episode, EpisodeRows};
use super::kernel::{Command, TaskKernel};
use super::layout::Layout;
use super::metrics::Outcome;
use super::observation::layout;
use super::options::{Goal, TaskOptions};
use super::pose::Pose;
use super::stance::Stance;
use crate::control::{ACTIONS, ActionKind, ActionMap, ActionRange, Allocation};
use crate::description::{Joint, JointKind, Scene};
use crate::error::{ControlError, TaskError};
use crate::lane::Real;
use crate::system::{EndEffector, JOINTS, Joints, State};

/// Control periods after which an episode is usually cut off: 20 s.
pub const DEFAULT_HORIZON: u32 = 400;

/// A task on one scene; the same for all instances and episodes.
///
/// A run goes: [`Self::begin`]; then per control period [`Self::observe`], [`Self::act`], the physics with that
/// [`Command`], [`Self::advance`]. With the pose error `p = sqrt(|e|^2 + (0.5 m angle)^2)` the reward is
/// `-0.1 (ln(1 + (p / 0.02 m)^2) + p / 0.3 m) - 0.02 mean((T / T_max)^2) - 0.1 mean((a - a_prev)^2)`,
/// its three weights being options. It is never positive, yet fleeing beyond the bounds to end an episode costs more than holding station.
#[derive(Debug, Clone, PartialEq)]
pub struct Task {
    pub(super) options: TaskOptions,
    rig: Rig,
    thruster_names: Vec<String>,
    joint_names: Vec<String>,
    pub(super) joints: Vec<Joint>,
    pub(super) scene: Scene,
    /// Orthonormal, world axes: two horizontal ones and the one against gravity (world z without gravity).
    pub(super) level: [Vector3<f64>; 3],
    /// Greatest amplitude of a path's turns out of the horizontal, rad.
    pub(super) tilt: f64,
    kernel: TaskKernel<f64>,
}

/// What the task reads of a scene in lanes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rig {
    pub layout: Layout,
    pub actions: ActionMap,
    pub end_effector: EndEffector,
    pub home: Joints,
    pub joints: usize,
    /// World axis against gravity (world z without gravity).
    pub up: [f64; 3],
    pub disturbance: Disturbance,
    pub site: Site,
}

impl Task {
    /// The task on `scene`.
    ///
    /// # Errors
    /// `TaskError`: a vehicle that is fixed, has no thrusters or (for wrench actions) no axis they can push along, a
    /// joint without a servo, or an option out of its range.
    pub fn new(scene: &Scene, options: TaskOptions) -> Result<Self, TaskError> {
        options.check()?;
        let mut scene = match options.task {
            Goal::StationKeep => scene.clone(),
            Goal::Track => with_drives(scene),
        };
        if let Some(lag) = options.thruster_lag {
            scene.vehicle.set_thruster_lag(lag);
        }
        let scene = &scene;
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
        let tracks = options.task == Goal::Track;
        let mut named = joints.iter().zip(scene.joint_names());
        if let Some((_, name)) = named.find(|(joint, _)| !tracks && joint.servo.is_none()) {
            return refuse(format!("joint \"{name}\" has no servo to follow its reference with"));
        }

        let up = (-scene.water.gravity).try_normalize(0.0).unwrap_or_else(Vector3::z);
        let forward = if up.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        let forward = (forward - up * up.dot(&forward)).normalize();
        let level = [forward, up.cross(&forward), up];
        let site = Site::new(scene, &allocation, level, options.control_period()).that_tracks(tracks);
        let disturbance = options.disturbance();
        if options.disturbance.is_some() || options.randomize.is_some() {
            disturbance.check(&site)?;
        }
        let (torques, tilt) = if tracks {
            (greatest_torques(scene, &up)?, greatest_tilt(scene, &up, allocation.wrench_limits())?)
        } else {
            (Vec::new(), 0.0)
        };
        let actions = ActionMap::new(options.action, allocation, torques);
        let rig = Rig {
            layout: layout(&options, &joints, actions.len()),
            actions,
            end_effector: EndEffector::new(scene),
            home: scene.home(),
            joints: joints.len(),
            up: up.into(),
            disturbance,
            site,
        };
        Ok(Self {
            tilt,
            kernel: TaskKernel::new(&options, &rig),
            rig,
            options,
            thruster_names: scene.thruster_names(),
            joint_names: scene.joint_names(),
            joints,
            scene: scene.clone(),
            level,
        })
    }

    /// What disturbs episodes.
    pub fn disturbance(&self) -> &Disturbance {
        &self.rig.disturbance
    }

    pub(super) fn site(&self) -> &Site {
        &self.rig.site
    }

    /// What disturbances will come to from where the episode stands, one entry per control period, for a vehicle that
    /// stays at rest in `pose`.
    pub fn profile(&self, episode: &Episode, pose: &Pose, steps: u32) -> Profile {
        let (mut numbers, pose) = (episode.numbers().to_vec(), pose.in_lanes());
        match self.kernel.weather() {
            Some(weather) => {
                let thrusters = self.rig.site.thrusters;
                weather.profile(&mut numbers, episode.key(), episode.step(), steps, &pose, thrusters)
            }
            None => Profile::steady(&episode.current(), steps, self.rig.site.thrusters),
        }
    }

    /// The frame whose pose counts: the vehicle's, or that of the end effector that follows a path.
    pub(super) fn frame(&self, state: &State) -> Pose {
        match self.options.task {
            Goal::StationKeep => Pose::of_vehicle(state),
            Goal::Track => self.end_effector(&Pose::of_vehicle(state), &state.q),
        }
    }

    /// The end effector of a vehicle at that pose.
    pub(super) fn end_effector(&self, vehicle: &Pose, q: &Joints) -> Pose {
        let (rotation, position) = self.rig.end_effector.pose(q);
        Pose { position: vehicle.position + vehicle.rotation * position, rotation: vehicle.rotation * rotation }
    }

    pub(super) fn home(&self) -> &Joints {
        &self.rig.home
    }

    /// Options in use.
    pub fn options(&self) -> &TaskOptions {
        &self.options
    }

    /// The scene as the task has it.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Name of the scene.
    pub fn scene_name(&self) -> &str {
        &self.scene.name
    }

    /// What each entry of an observation is.
    pub fn layout(&self) -> &Layout {
        &self.rig.layout
    }

    /// Entries of an observation.
    pub fn observation_len(&self) -> usize {
        self.rig.layout.len()
    }

    /// Entries of an action.
    pub fn action_len(&self) -> usize {
        self.rig.actions.len()
    }

    /// What each entry of an action is.
    pub fn action_ranges(&self) -> Vec<ActionRange> {
        let actions = &self.rig.actions;
        let mut ranges = actions.ranges(self.thruster_names.iter().map(String::as_str));
        for ((torque, name), joint) in actions.torques().iter().zip(&self.joint_names).zip(&self.joints) {
            let unit = match joint.kind {
                JointKind::Revolute => "N m",
                JointKind::Prismatic => "N",
            };
            ranges.push(ActionRange { name: name.clone(), limits: [-torque, *torque], unit });
        }
        if self.options.action == ActionKind::Residual {
            ranges.iter_mut().for_each(|range| range.limits = range.limits.map(|limit| limit * self.options.residual));
        }
        ranges
    }

    /// The thruster allocation.
    pub fn allocation(&self) -> &Allocation {
        self.rig.actions.allocation()
    }

    /// Number of joints.
    pub fn joint_count(&self) -> usize {
        self.joints.len()
    }

    /// A refusal of something for this task.
    pub(super) fn unfit(&self, reason: &str) -> TaskError {
        TaskError::Scene { scene: self.scene.name.clone(), reason: reason.to_owned() }
    }

    pub(super) fn actions(&self) -> &ActionMap {
        &self.rig.actions
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
        // Without a way out, so that it is done in lanes.
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

    /// Numbers of the task for a group of instances.
    pub fn in_lanes<T: Real>(&self) -> TaskKernel<T> {
        TaskKernel::new(&self.options, &self.rig)
    }

    /// The same for one instance.
    pub(super) fn kernel(&self) -> &TaskKernel<f64> {
        &self.kernel
    }

    /// Where the numbers of an episode lie.
    pub fn episode_rows(&self) -> EpisodeRows {
        *self.kernel.rows()
    }

    /// [`TaskKernel::act`] for one instance.
    pub fn act(&self, episode: &mut Episode, action: &[f32]) -> Command<f64> {
        let mut entries = [0.0; ACTIONS];
        entries.iter_mut().zip(action).for_each(|(entry, a)| *entry = f64::from(*a));
        if let Some(weather) = self.kernel().weather() {
            let (key, step) = (episode.key(), episode.step());
            weather.stir(&mut Column::of_one(&mut episode.numbers), key, step);
        }
        let mut command = Command::none();
        self.kernel().act(&mut episode.memory(), &mut entries, None, &mut command);
        command
    }

    /// [`TaskKernel::advance`] for one instance.
    pub fn advance(&self, episode: &mut Episode, state: &State) -> Outcome {
        episode.step += 1;
        let (share, stance) = (1.0 / f64::from(episode.step), Stance::from(state));
        let mut memory = episode.memory();
        self.kernel().advance::<f64>(&mut memory);
        let error = self.kernel().error(&memory, &stance);
        Outcome::from(&self.kernel().judge(&mut memory, &stance, &error, share))
    }

    /// [`TaskKernel::observe`] for one instance.
    pub fn observe(&self, episode: &Episode, state: &State, row: &mut [f32]) {
        let (mut episode, stance) = (episode.clone(), Stance::from(state));
        let memory = episode.memory();
        let error = self.kernel().error(&memory, &stance);
        self.kernel().observe(&memory, &stance, &error, row);
    }
}

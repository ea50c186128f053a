//! Station keeping: the vehicle holds a pose while the arm moves and a current pushes.

use nalgebra::{Vector3, Vector6};

use super::episode::{ACTIONS, Episode};
use super::layout::Layout;
use super::metrics::{Metrics, Outcome, RewardTerms};
use super::observation::{LEAK, POSITION_BOUND, station_keep_layout};
use super::options::StationKeepOptions;
use super::pose::{Pose, PoseError};
use super::reference::hermite;
use crate::control::{ActionKind, ActionMap, ActionRange, Allocation, Pd, Reading, Thrusts};
use crate::description::{Joint, Scene, VehicleServo};
use crate::error::{ControlError, TaskError};
use crate::system::{JOINTS, Joints, State};

/// Control periods after which an episode is usually cut off: 20 s.
pub const DEFAULT_HORIZON: u32 = 400;

/// Metres that a radian of attitude error counts as.
const RADIAN: f64 = 0.5;
/// Pose errors at which the reward's logarithm and its linear part set in, m. They are the user's accuracy, not the
/// vehicle's size: no scene scales them.
const FINE: f64 = 0.02;
const COARSE: f64 = 0.3;
/// The station-keeping task on one scene; the same for all instances and episodes.
///
/// A run goes: [`Self::begin`]; then per control period [`Self::observe`], [`Self::act`], the physics with that
/// [`Command`], [`Self::advance`]. With the pose error `p = sqrt(|e|^2 + (0.5 m angle)^2)` the reward is
/// `-0.1 (ln(1 + (p / 0.02 m)^2) + p / 0.3 m) - 0.02 mean((T / T_max)^2) - 0.1 mean((a - a_prev)^2)`,
/// its three weights being options. It is never positive, yet fleeing beyond the bounds to end an episode costs more than holding station.
#[derive(Debug, Clone, PartialEq)]
pub struct StationKeep {
    pub(super) options: StationKeepOptions,
    actions: ActionMap,
    thruster_names: Vec<String>,
    pub(super) joints: Vec<Joint>,
    pub(super) home: Joints,
    servo: Option<VehicleServo>,
    scene_name: String,
    pub(super) scene_current: Vector3<f64>,
    /// Orthonormal, world axes: two horizontal ones and the one against gravity (world z without gravity).
    pub(super) level: [Vector3<f64>; 3],
    layout: Layout,
}

/// What the physics needs over one control period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Thrusts within their limits, N.
    pub thrusts: Thrusts,
    /// Their body wrench at the vehicle origin, N and N m.
    pub wrench: Vector6<f64>,
    /// Joint servo targets: per joint the cubic `c0 + c1 s + c2 s^2 + c3 s^3` in the time s since the period's start.
    /// It meets the reference's value and rate at both ends of the period. Zeros past the scene's joints.
    pub joints: [[f64; 4]; JOINTS],
}

impl StationKeep {
    /// The task on `scene`.
    ///
    /// # Errors
    /// `TaskError`: a vehicle that is fixed, has no thrusters or (for wrench actions) no axis they can push along, a
    /// joint without a servo, or an option out of its range.
    pub fn new(scene: &Scene, options: StationKeepOptions) -> Result<Self, TaskError> {
        options.check()?;
        let refuse = |reason: String| Err(TaskError::Scene { scene: scene.name.clone(), reason });
        let vehicle = &scene.vehicle;
        if vehicle.fixed {
            return refuse("its vehicle is fixed".into());
        }
        if vehicle.thrusters.is_empty() {
            return refuse("its vehicle has no thrusters".into());
        }
        let allocation = Allocation::new(vehicle)?;
        if options.action == ActionKind::Wrench && allocation.unactuated().len() == 6 {
            let hint = "no axis of the wrench can be actuated alone (action \"thrusters\" may work)";
            return refuse(hint.into());
        }
        let joints: Vec<Joint> = scene.joints().cloned().collect();
        if joints.len() > JOINTS {
            return refuse(format!("it has {} joints, at most {JOINTS} are supported", joints.len()));
        }
        if let Some((_, name)) = joints.iter().zip(scene.joint_names()).find(|(joint, _)| joint.servo.is_none()) {
            return refuse(format!("joint \"{name}\" has no servo to follow its reference with"));
        }

        let up = (-scene.water.gravity).try_normalize(0.0).unwrap_or_else(Vector3::z);
        let forward = if up.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        let forward = (forward - up * up.dot(&forward)).normalize();
        let actions = ActionMap::new(options.action, allocation);
        Ok(Self {
            layout: station_keep_layout(&joints, actions.len()),
            options,
            actions,
            thruster_names: scene.thruster_names(),
            joints,
            home: scene.home(),
            servo: vehicle.servo.clone(),
            scene_name: scene.name.clone(),
            scene_current: scene.water.current,
            level: [forward, up.cross(&forward), up],
        })
    }

    /// Options in use.
    pub fn options(&self) -> &StationKeepOptions {
        &self.options
    }

    /// Name of the scene.
    pub fn scene_name(&self) -> &str {
        &self.scene_name
    }

    /// What each entry of an observation is.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Entries of an observation.
    pub fn observation_len(&self) -> usize {
        self.layout.len()
    }

    /// Entries of an action.
    pub fn action_len(&self) -> usize {
        self.actions.len()
    }

    /// What each entry of an action is.
    pub fn action_ranges(&self) -> Vec<ActionRange> {
        self.actions.ranges(self.thruster_names.iter().map(String::as_str))
    }

    /// The thruster allocation.
    pub fn allocation(&self) -> &Allocation {
        self.actions.allocation()
    }

    /// Number of joints.
    pub fn joint_count(&self) -> usize {
        self.joints.len()
    }

    /// The paper's PD for this task, with these gains or the scene's own (`vehicle.servo`).
    ///
    /// # Errors
    /// `TaskError` if there are no gains, or one is not finite or is negative.
    pub fn pd(&self, gains: Option<VehicleServo>) -> Result<Pd, TaskError> {
        let Some(gains) = gains.or_else(|| self.servo.clone()) else {
            let reason = "it gives no gains (vehicle.servo) for the PD".into();
            return Err(TaskError::Scene { scene: self.scene_name.clone(), reason });
        };
        let find = |names: [&str; 2]| {
            let mut found = names
                .into_iter()
                .filter_map(|name| self.layout.block(name))
                .flat_map(|block| block.scale.iter().enumerate().map(|(k, scale)| (block.offset + k, *scale)));
            std::array::from_fn(|_| found.next().expect("every layout holds these two blocks of three"))
        };
        let reading = Reading {
            width: self.observation_len(),
            error: find(["position_error", "attitude_error"]),
            twist: find(["linear_velocity", "angular_velocity"]),
        };
        Ok(Pd::new(reading, gains, self.actions.clone())?)
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
        match actions.iter().position(|a| !a.is_finite()) {
            None => Ok(()),
            Some(at) => {
                let (instance, index) = (at / self.action_len(), at % self.action_len());
                Err(TaskError::Action { instance, index, value: actions[at] })
            }
        }
    }

    /// Takes an action (entries beyond [-1, 1] are clipped, NaN counts as 0) for the coming control period.
    pub fn act(&self, episode: &mut Episode, action: &[f32]) -> Command {
        episode.previous_action = episode.action;
        let mut clipped = [0.0; ACTIONS];
        for (c, &a) in clipped.iter_mut().zip(action).take(self.action_len()) {
            *c = if a.is_nan() { 0.0 } else { a.clamp(-1.0, 1.0) };
        }
        episode.action = clipped;
        episode.thrusts = self.actions.thrusts(&clipped[..self.action_len()]);
        let mut joints = [[0.0; 4]; JOINTS];
        for (i, cubic) in joints.iter_mut().enumerate().take(self.joints.len()) {
            *cubic = hermite(&episode.now[i], &episode.next[i], self.options.control_period());
        }
        Command { thrusts: episode.thrusts, wrench: self.allocation().wrench(&episode.thrusts), joints }
    }

    /// Moves the episode to the control instant that `state` has reached, and judges it. `end_effector` gives the
    /// end effector's pose for a vehicle pose and joint coordinates.
    ///
    /// Errors that are beyond the bounds or no numbers count as the bounds, so that all results are finite.
    pub fn advance(
        &self,
        episode: &mut Episode,
        state: &State,
        end_effector: impl Fn(&Pose, &Joints) -> Pose,
    ) -> Outcome {
        let period = self.options.control_period();
        episode.step += 1;
        episode.now = episode.next;
        let next = f64::from(episode.step + 1) * period;
        for (point, reference) in episode.next.iter_mut().zip(&episode.references).take(self.joints.len()) {
            *point = reference.at(next);
        }

        let error = Pose::of_vehicle(state).error_from(&episode.target);
        let diverged = self.violation(&episode.target, state).is_some();
        if !diverged {
            // Exact for an error that is constant over the period.
            let keep = (-LEAK * period).exp();
            episode.integral = episode.integral * keep + stack(&error) * ((1.0 - keep) / LEAK);
        }
        let mut metrics = self.measure(episode, state, end_effector);
        metrics.accumulate(&mut episode.sums, episode.step);

        let weights = &self.options.reward;
        let pose_error = metrics.position_error.hypot(RADIAN * metrics.attitude_error);
        let change: f64 =
            episode.action.iter().zip(&episode.previous_action).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        let terms = RewardTerms {
            pose: -weights.pose * ((pose_error / FINE).powi(2).ln_1p() + pose_error / COARSE),
            effort: -weights.effort * self.mean_thrust(episode, |u| u * u),
            rate: -weights.rate * change / self.action_len() as f64,
        };
        let reward = terms.pose + terms.effort + terms.rate;
        Outcome { reward, terms, terminated: diverged, diverged, metrics }
    }

    /// What there is to say of an episode at its start: measures as they are, no reward, running means still 0.
    pub fn survey(&self, episode: &Episode, state: &State, end_effector: impl Fn(&Pose, &Joints) -> Pose) -> Outcome {
        let metrics = self.measure(episode, state, end_effector);
        Outcome { reward: 0.0, terms: RewardTerms::default(), terminated: false, diverged: false, metrics }
    }

    /// Measures at the current control instant, without running means.
    fn measure(&self, episode: &Episode, state: &State, end_effector: impl Fn(&Pose, &Joints) -> Pose) -> Metrics {
        let pose = Pose::of_vehicle(state);
        let (position_error, attitude_error) = magnitudes(&pose.error_from(&episode.target));
        let reached = end_effector(&pose, &state.q);
        let wanted = end_effector(&episode.target, &episode.now.map(|point| point.value));
        let (end_effector_position_error, end_effector_attitude_error) = magnitudes(&reached.error_from(&wanted));
        Metrics {
            position_error,
            attitude_error,
            end_effector_position_error,
            end_effector_attitude_error,
            effort: self.mean_thrust(episode, |u| u.abs() * u.abs().sqrt()),
            saturation: self.allocation().saturation(&episode.thrusts),
            running: [0.0; 6],
            current: episode.current,
        }
    }

    /// Mean over the thrusters of a function of their relative thrust.
    fn mean_thrust(&self, episode: &Episode, of: fn(f64) -> f64) -> f64 {
        let allocation = self.allocation();
        allocation.relative(&episode.thrusts).map(of).sum::<f64>() / allocation.count() as f64
    }
}

fn stack(error: &PoseError) -> Vector6<f64> {
    let (p, r) = (&error.position, &error.rotation);
    Vector6::new(p.x, p.y, p.z, r.x, r.y, r.z)
}

/// Distance and angle of an error, at most the bounds; NaN counts as the bound.
fn magnitudes(error: &PoseError) -> (f64, f64) {
    (error.position.norm().min(POSITION_BOUND), error.rotation.norm().min(std::f64::consts::PI))
}

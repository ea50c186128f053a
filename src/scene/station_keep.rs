//! Station keeping: the vehicle holds a pose while the arm moves and a current pushes.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3, Vector6};

use super::episode::{ACTIONS, Episode};
use super::layout::Layout;
use super::metrics::{Metrics, Outcome, RewardTerms};
use super::options::{StartOverride, StationKeepOptions};
use super::pose::{Pose, PoseError};
use super::random::{EpisodeKey, Purpose, Stream};
use super::reference::{JointReference, METRES_PER_RADIAN, ReferencePoint, hermite};
use crate::control::{ActionKind, ActionMap, ActionRange, Allocation, Pd, Reading, Thrusts};
use crate::description::{Joint, JointKind, Scene, VehicleServo};
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
#[derive(Debug, Clone, PartialEq)]
pub struct StationKeep {
    options: StationKeepOptions,
    actions: ActionMap,
    thruster_names: Vec<String>,
    joints: Vec<Joint>,
    home: Joints,
    servo: Option<VehicleServo>,
    scene_name: String,
    scene_current: Vector3<f64>,
    /// Orthonormal, world axes: two horizontal ones and the one against gravity (world z without gravity).
    level: [Vector3<f64>; 3],
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
        let joints: Vec<Joint> = match &scene.arm {
            Some(arm) => arm.mount.joint.iter().chain(arm.links.iter().map(|l| &l.joint)).cloned().collect(),
            None => Vec::new(),
        };
        if joints.len() > JOINTS {
            return refuse(format!("it has {} joints, at most {JOINTS} are supported", joints.len()));
        }
        if let Some(index) = joints.iter().position(|j| j.servo.is_none()) {
            return refuse(format!("joint {index} (from 0) has no servo to follow its reference"));
        }
        let mut home = [0.0; JOINTS];
        home.iter_mut().zip(&joints).for_each(|(h, joint)| *h = joint.home);

        let up = (-scene.water.gravity).try_normalize(0.0).unwrap_or_else(Vector3::z);
        let forward = if up.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        let forward = (forward - up * up.dot(&forward)).normalize();
        let actions = ActionMap::new(options.action, allocation);
        Ok(Self {
            layout: layout(&joints, actions.len()),
            options,
            actions,
            thruster_names: vehicle.thrusters.iter().map(|t| t.name.clone()).collect(),
            joints,
            home,
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

    /// What each entry of an observation is.
    pub

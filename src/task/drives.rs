//! Driven joints: torque limits and the tilt of paths, from the loads of a scene.

use nalgebra::{Rotation3, Vector3};

use super::random::{EpisodeKey, Purpose, Stream};
use super::reference::PRISMATIC_PER_RADIAN;
use crate::description::{Joint, JointServo, Scene};
use crate::dynamics::ClosedFormModel;
use crate::error::{DynamicsError, TaskError};
use crate::system::State;

/// Accelerations of a joint under an action of 1, rad/s^2 (times [`PRISMATIC_PER_RADIAN`] in m/s^2): with the other joints
/// and the vehicle free, and with all else fixed.
const ACCELERATION: [f64; 2] = [10.0, 2.0];
/// Number of poses at which the arm's weight and inertia are evaluated.
const POSES: u32 = 64;
/// Maximum share of the thrusters' moments for a path's rotation out of the horizontal.
const TILTING: f64 = 0.4;
/// Tilt at which the restoring moment is evaluated, rad.
const SMALL_TILT: f64 = 0.05;

/// Limits of driven joints.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct JointDrives {
    /// Torque of an action of 1 per joint, N m or N.
    pub torques: Vec<f64>,
    /// Maximum amplitude of a path's rotation out of the horizontal, rad.
    pub tilt: f64,
}

impl JointDrives {
    /// Drives of a scene's joints; `limits` belong to the thrusters' wrench.
    pub(super) fn new(scene: &Scene, up: &Vector3<f64>, limits: [f64; 6]) -> Result<Self, TaskError> {
        Ok(Self { torques: max_torques(scene, up)?, tilt: max_tilt(scene, up, limits)? })
    }
}

/// The scene with its joints driven by torques. The damping of their servos stays on as friction, which keeps light joints
/// from diverging between control instants: for all joints, or only for those without rotor inertia.
pub(super) fn with_drives(scene: &Scene, all: bool) -> Scene {
    let mut scene = scene.clone();
    for joint in scene.joints_mut() {
        if let Some(servo) = &mut joint.servo {
            if all || joint.rotor_inertia == 0.0 {
                joint.friction.viscous += servo.kd;
            }
            *servo = JointServo { kp: 0.0, kd: 0.0 };
        }
    }
    scene
}

/// Torque of an action of 1 at each joint, N m or N: the joint's effort or, if smaller, twice the holding torque of
/// the arm in any pose, plus friction at 1 rad/s and the [`ACCELERATION`]s. A light joint then does not diverge within a
/// control period.
fn max_torques(scene: &Scene, up: &Vector3<f64>) -> Result<Vec<f64>, TaskError> {
    let (balance, joints) = (model(scene)?, scene.joints().collect::<Vec<_>>());
    let draw = Stream::new(EpisodeKey::default(), Purpose::START);
    let mut holding = vec![0.0f64; joints.len()];
    let mut mobility = vec![0.0f64; joints.len()];
    let mut inertia = vec![0.0f64; joints.len()];
    for pose in 0..POSES {
        let index = 16 * pose;
        let tilt = Rotation3::rotation_between(up, &(up + draw.unit_vector(index) * 0.5)).unwrap_or_default();
        let mut state = State { rotation: tilt.into_inner(), q: scene.home(), ..State::default() };
        for (k, joint) in joints.iter().enumerate() {
            let [lower, upper] = joint.limits.as_ref().map_or([-1.0, 1.0], |limits| [limits.lower, limits.upper]);
            state.q[k] = draw.uniform_in(index + 1 + k as u32, lower, upper);
        }
        let effort = balance.trim(&state, Vector3::zeros()).map_err(|error| unfit(scene, &error))?;
        let mass = balance.at(&state, Vector3::zeros()).mass_matrix().clone();
        let inverse = mass.clone().cholesky().map(|m| m.inverse());
        for k in 0..joints.len() {
            holding[k] = holding[k].max(effort.joint_torques[k].abs());
            inertia[k] = inertia[k].max(mass[(6 + k, 6 + k)]);
            mobility[k] = mobility[k].max(inverse.as_ref().map_or(0.0, |m| m[(6 + k, 6 + k)]));
        }
    }
    let torque = |(k, joint): (usize, &&Joint)| {
        let unit = if joint.slides() { PRISMATIC_PER_RADIAN } else { 1.0 };
        let friction = joint.friction.viscous * unit + joint.friction.at_rest();
        let [free, fixed] = ACCELERATION.map(|acceleration| acceleration * unit);
        let enough = 2.0 * holding[k] + friction + (free / mobility[k]).max(fixed * inertia[k]);
        joint.effort.map_or(enough, |effort| effort.min(enough))
    };
    Ok(joints.iter().enumerate().map(torque).collect())
}

/// Maximum amplitude of rotation out of the horizontal, rad: at twice that, the maximum distance from the start, holding
/// the vehicle takes the share [`TILTING`] of the thrusters' moments about either axis. 0 without moments.
fn max_tilt(scene: &Scene, up: &Vector3<f64>, limits: [f64; 6]) -> Result<f64, TaskError> {
    let balance = model(scene)?;
    let hold = |rotation: Rotation3<f64>| {
        let state = State { rotation: rotation.into_inner(), q: scene.home(), ..State::default() };
        balance.trim(&state, Vector3::zeros()).map(|effort| effort.wrench).map_err(|error| unfit(scene, &error))
    };
    let upright = Rotation3::rotation_between(&Vector3::z(), up).unwrap_or_default();
    let level = hold(upright)?;
    let mut maximum = f64::INFINITY;
    for (axis, limit) in [(Vector3::x(), limits[3]), (Vector3::y(), limits[4])] {
        let tilted = hold(upright * Rotation3::from_scaled_axis(axis * SMALL_TILT))?;
        let stiffness = (tilted - level).fixed_rows::<3>(3).norm() / SMALL_TILT;
        maximum = maximum.min(if limit > 0.0 { 0.5 * TILTING * limit / stiffness } else { 0.0 });
    }
    Ok(maximum)
}

fn model(scene: &Scene) -> Result<ClosedFormModel, TaskError> {
    ClosedFormModel::new(scene).map_err(|error| unfit(scene, &error))
}

fn unfit(scene: &Scene, error: &DynamicsError) -> TaskError {
    TaskError::Scene { scene: scene.name.clone(), reason: error.to_string() }
}

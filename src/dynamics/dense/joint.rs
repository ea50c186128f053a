//! Joint kinematics, friction, spring, detent, actuator torque and end stops.

use std::f64::consts::TAU;

use nalgebra::{Vector3, Vector6};

use super::se3::{DensePose, stack};
use crate::description::{Detent, Joint, JointSpring};

/// Joint matrix E: twist of the child in its own frame per joint rate. `[HC eq. 9]`
pub fn joint_axis(joint: &Joint) -> Vector6<f64> {
    let zero = Vector3::zeros();
    if joint.slides() { stack(&joint.axis, &zero) } else { stack(&zero, &joint.axis) }
}

/// Pose of the child frame in the parent frame at joint coordinate `q`.
pub fn joint_pose(joint: &Joint, q: f64) -> DensePose {
    let motion = if joint.slides() { DensePose::shift(joint.axis * q) } else { DensePose::turn(&joint.axis, q) };
    DensePose::from_frame(&joint.frame) * motion
}

/// Friction `-(viscous qd + c(qd) qd / sqrt(qd^2 + coulomb_speed^2))`, N m or N, with the dry part c by Stribeck's law.
pub fn friction(joint: &Joint, qd: f64) -> f64 {
    let friction = &joint.friction;
    let direction = if qd == 0.0 { 0.0 } else { qd / qd.hypot(friction.coulomb_speed) };
    let excess = friction.at_rest() - friction.coulomb;
    let dry = match friction.stribeck_speed {
        Some(speed) => friction.coulomb + excess / (1.0 + (qd / speed).powi(2)),
        None => friction.coulomb,
    };
    -(friction.viscous * qd + dry * direction)
}

/// Torque of spring and detent, N m or N, and their energy, J, which is 0 where they rest.
pub fn spring(joint: &Joint, q: f64) -> (f64, f64) {
    let (mut torque, mut energy) = (0.0, 0.0);
    if let Some(JointSpring { stiffness, rest }) = joint.spring {
        torque -= stiffness * (q - rest);
        energy += 0.5 * stiffness * (q - rest).powi(2);
    }
    if let Some(Detent { torque: maximum, period, offset }) = joint.detent {
        let angle = TAU * (q - offset) / period;
        torque -= maximum * angle.sin();
        energy += maximum * period / TAU * (1.0 - angle.cos());
    }
    (torque, energy)
}

/// Actuator torque, N m or N: `command` plus the servo's torque towards `target` `(q_d, q_d')`, limited to the effort.
pub fn actuator_torque(joint: &Joint, q: f64, qd: f64, command: f64, target: Option<(f64, f64)>) -> f64 {
    let servo = match (&joint.servo, target) {
        (Some(servo), Some((position, rate))) => servo.kp * (position - q) + servo.kd * (rate - qd),
        _ => 0.0,
    };
    let effort = joint.effort_at(q);
    (command + servo).min(effort).max(-effort)
}

/// End stop of a joint beyond a limit by the signed excess `p`: elastic torque `-stiffness p`, damping torque
/// `-damping |p| qd` and elastic energy `stiffness p^2 / 2`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EndStop {
    /// Elastic torque, N m or N.
    pub elastic: f64,
    /// Damping torque, N m or N.
    pub damping: f64,
    /// Elastic energy, J.
    pub energy: f64,
}

impl EndStop {
    /// End stop of `joint` at `(q, qd)`.
    pub fn new(joint: &Joint, q: f64, qd: f64) -> Self {
        let Some(limits) = &joint.limits else { return Self::default() };
        let p = (q - limits.upper).max(0.0) + (q - limits.lower).min(0.0);
        Self {
            elastic: -limits.stiffness * p,
            damping: -limits.damping * p.abs() * qd,
            energy: 0.5 * limits.stiffness * p * p,
        }
    }
}

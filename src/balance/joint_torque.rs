//! Torque at a joint: actuator, friction, end stops.

use crate::lane::{Lane, Param, get_all};
use crate::system::JointTerms;

/// Torque along +q. `command` is the actuator's, `target` the servo's `(q_d, q_d')` if it is on.
#[inline(always)]
pub fn joint_torque<L: Lane, P: Param<L>>(joint: &JointTerms<P>, q: L, qd: L, command: L, target: Option<(L, L)>) -> L {
    let mut torque = command;
    if let (Some(servo), Some((position, rate))) = (&joint.servo, target) {
        torque = servo.kp.get().mul_add(position - q, servo.kd.get().mul_add(rate - qd, torque));
    }
    if let Some(effort) = joint.effort {
        torque = torque.min(effort.get()).max(-effort.get());
    }
    if let Some(friction) = &joint.friction {
        torque = friction.viscous.get().neg_mul_add(qd, torque);
        if let Some([coulomb, speed_squared]) = friction.coulomb {
            torque -= coulomb.get() * qd / qd.mul_add(qd, speed_squared.get()).sqrt();
        }
    }
    if let Some(limits) = &joint.limits {
        let [lower, upper] = get_all(&limits.range);
        let [stiffness, damping] = get_all(&limits.stop);
        let excess = (q - upper).max(L::zero()) - (lower - q).max(L::zero());
        torque = stiffness.neg_mul_add(excess, (damping * excess.abs()).neg_mul_add(qd, torque));
    }
    torque
}

//! Adjoint of the joint torques, by dual numbers: each depends on three numbers.

use super::joint_torque::{implicit_joint_torque, joint_torque};
use crate::lane::{Dual, Lane};
use crate::system::JointTerms;

/// Cotangents of the numbers that a joint's torque depends on.
pub(super) struct JointCotangents<L> {
    pub q: L,
    pub qd: L,
    pub command: L,
    /// Target, and its rate.
    pub target: [L; 2],
}

/// Cotangents from the cotangents of the torque and, for a linearly implicit method of step h, of its decrease per acceleration.
#[inline(always)]
pub(super) fn joint_torque_adjoint<L: Lane, const IMPLICIT: bool>(
    joint: &JointTerms<L>,
    h: L,
    [q, qd, command]: [L; 3],
    target: Option<(L, L)>,
    of: [L; 2],
) -> JointCotangents<L> {
    let (zero, one) = (L::zero(), L::c(1.0));
    let constant = |x| Dual::new(x, zero);
    let fixed = if let Some((position, rate)) = target { Some((constant(position), constant(rate))) } else { None };
    let mut slopes = [zero; 3];
    for k in 0..3 {
        let along = |i: usize, x| Dual::new(x, if i == k { one } else { zero });
        let (q, qd, command) = (along(0, q), along(1, qd), along(2, command));
        slopes[k] = if IMPLICIT {
            let (torque, decrease) = implicit_joint_torque(joint, constant(h), q, qd, command, fixed);
            torque.slope.mul_add(of[0], decrease.slope * of[1])
        } else {
            joint_torque(joint, q, qd, command, fixed).slope * of[0]
        };
    }
    let [q, qd, command] = slopes;
    // The servo's torque adds to the command.
    let target = match (&joint.servo, target) {
        (Some(servo), Some(_)) => [servo.kp * command, servo.kd * command],
        _ => [zero; 2],
    };
    JointCotangents { q, qd, command, target }
}

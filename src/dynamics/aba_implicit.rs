//! Articulated-body algorithm for linearly implicit Euler: `(I - h J) k = f` in O(n).
//!
//! With `y = (Theta, q; V, q')` a step of linearly implicit Euler is `y + h k`. The order of the method does not depend on
//! J. Here J is `[[0, I], [-M^-1 K, -M^-1 D]]` with symmetric D, K >= 0: secants of damping, restoring forces, friction,
//! servos, station keeping, end stops and contacts with shapes in the world, or bounds of them. The accelerations follow from
//!
//! ```text
//! (M + h D + h^2 K) [V'; q''] = forces at the present rates and at the pose after a time h at these rates
//! ```
//!
//! D and K belong to bodies or to joints, and displacements compose along the chain as twists do. The recursion of
//! [`super::aba`] therefore solves this with `A_i + h D_i + h^2 K_i` as the inertia of each body and `h (d + h k)` added to D
//! of each joint. h D_i multiplies all of `V_i'`, velocity products included: that is the change of the body's twist. No
//! pivot is smaller than in the explicit form.

#![allow(non_snake_case, reason = "inertias, twists and wrenches carry the symbols of the header")]

use std::hint::cold_path;

use super::aba::{ArmLoads, Instant, Scratch, body_bias};
use super::branches::{motion_at_carrier, rate_at_carrier};
use super::joint_torque::implicit_joint_torque;
use super::link::{Drive, add_joint_rate, joint_screws, with_zeros};
use crate::lane::{Lane, Param, unroll};
use crate::lie::{Matrix3, Vector3, Vector6};
use crate::spatial::SpatialInertia;
use crate::system::{BodyTerms, JOINTS, System};

/// Step of a linearly implicit method: the time ahead at which forces are evaluated.
#[derive(Debug, Clone, Copy)]
pub struct Ahead<L> {
    /// Step size, s. [`Instant::time`] is the time at the end of the step.
    pub h: L,
    /// True if the vehicle's servo is on: [`Instant::wrench`] then includes its wrench.
    pub vehicle_servo: bool,
}

/// `A + h D + h^2 K` of a body, and its bias wrench at the pose after a time h at the present twist.
#[inline(always)]
fn effective<L: Lane, B: Param<L>>(
    body: &BodyTerms<B>,
    h: L,
    twist: Vector6<L>,
    gravity: Vector3<L>,
) -> (SpatialInertia<L>, Vector6<L>) {
    let mut inertia: SpatialInertia<L> = body.inertia.get();
    let mut bias = Vector6::zero();
    body_bias::<_, _, false>(body, twist, gravity, &mut bias);
    for damping in &body.damping {
        inertia = damping.damping_matrix(twist).scale_add(h, &inertia);
    }
    if let Some(restoring) = &body.restoring {
        let stiffness = Matrix3::symmetric(&restoring.stiffness(gravity));
        bias.angular = stiffness.apply(twist.angular).scale_add(h, bias.angular);
        inertia.add_angular(h * h, &stiffness);
    }
    (inertia, bias)
}

/// `V'` with V relative to the water, and `q''`, of linearly implicit Euler. Entries of `qdd` past the joint count are
/// untouched.
#[inline(always)]
pub fn implicit_accelerations<L: Lane, P: Param<L>, B: Param<L>>(
    system: &System<P, B>,
    at: &Instant<L>,
    ahead: Ahead<L>,
    loads: &ArmLoads<L>,
    scratch: &mut Scratch<L>,
    twist_rate: &mut Vector6<L>,
    qdd: &mut [L; JOINTS],
) {
    let Instant { gravity, twist, q, qd, wrench, fixed_rate, time, .. } = *at;
    let Ahead { h, vehicle_servo } = ahead;
    let joints = system.chain();
    let Scratch { links, branches, contact, water, .. } = scratch;
    let links = &mut links[..joints.len()];
    if system.tree {
        cold_path();
        branches.clear(joints);
    }
    joint_screws(joints, true, q, links);
    let (mut g, mut V) = (gravity, twist);
    for i in 0..joints.len() {
        if let Some(carrier) = joints[i].branch.carrier {
            cold_path();
            (g, V) = motion_at_carrier(carrier, (water, at.elapsed), (gravity, twist), links);
        }
        let (joint, link) = (&joints[i], &mut links[i]);
        (g, V) = link.outward(joint, g, V, qd[i]);
        (link.g, link.V) = (g, V);
    }

    // Contribution of the outer links to this body's I_A and p_A.
    let (mut I_children, mut p_children) = (SpatialInertia::zero(), Vector6::zero());
    for i in (0..joints.len()).rev() {
        let (joint, link) = (&joints[i], &mut links[i]);
        let (I, mut p) = effective(&joint.body, h, link.V, link.g);
        if loads.on_links {
            p = p - loads.links[i];
        }
        if system.contact.is_some() {
            cold_path();
            p = p - contact.links[i];
        }
        if joint.branch.forks {
            cold_path();
            branches.take(i + 1, &mut I_children, &mut p_children);
        }
        let I_A = I.plus(&I_children);
        p = p + p_children;
        let target = loads.target(i, time);
        let drive = if joint.prescribed {
            // The difference quotient that ends at the target's rate.
            Drive::Acceleration(target.map_or_else(L::zero, |(_, rate)| (rate - qd[i]) / h))
        } else {
            let (tau, damping) = implicit_joint_torque(joint, h, q[i], qd[i], loads.torque[i], target);
            Drive::Torque { tau, damping: Some(damping) }
        };
        (I_children, p_children) = link.eliminate(joint, &I_A, p, drive);
        if let Some(carrier) = joint.branch.carrier {
            cold_path();
            branches.add(carrier, &mut I_children, &mut p_children);
        } else if i == 0 && system.tree {
            cold_path();
            branches.take(0, &mut I_children, &mut p_children);
        }
    }

    if let Some(linear) = fixed_rate {
        *twist_rate = Vector6 { linear, angular: Vector3::zero() };
    } else {
        let (I, p) = effective(&system.vehicle, h, twist, gravity);
        let mut I_A = I.plus(&I_children);
        let mut force = (*wrench - (p + p_children)).to_array();
        if let (true, Some(gains)) = (vehicle_servo, &system.vehicle_servo) {
            let rate = twist.to_array();
            unroll!(i in 0 1 2 3 4 5 => {
                let spring = gains.kp[i].get() * h;
                force[i] = spring.neg_mul_add(rate[i], force[i]);
                I_A.add_diagonal(i, (gains.kd[i].get() + spring) * h);
            });
        }
        *twist_rate = I_A.solve(Vector6::from_array(force));
    }

    let mut V_dot = *twist_rate;
    for i in 0..joints.len() {
        if let Some(carrier) = joints[i].branch.carrier {
            cold_path();
            V_dot = rate_at_carrier(carrier, water, *twist_rate, links);
        }
        let (joint, link) = (&joints[i], &mut links[i]);
        V_dot = link.twist_from_parent(joint, V_dot) + with_zeros(link.c);
        qdd[i] = link.u_over_D - link.U_over_D.dot(V_dot);
        V_dot = add_joint_rate(joint, V_dot, qdd[i]);
        if joint.branch.forks {
            cold_path();
            link.V = V_dot;
        }
    }
}

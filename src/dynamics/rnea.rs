//! Recursive Newton-Euler algorithm: inverse dynamics in O(n), in lanes. `[RF08 ch. 5]`
//!
//! ```text
//! outward   V_i = Ad^-1 V_p + E q',   A_i = Ad^-1 A_p + ad_V_i E q' + E q'',   F_i = I A_i + B V_i - restoring - damping
//! inward    tau_i = E^T F_i + J q'',   F_p += Ad^-T F_i
//! ```

#![allow(non_snake_case, reason = "twists and wrenches carry the symbols of the header")]

use std::hint::cold_path;

use super::aba::{Scratch, body_bias};
use super::branches::{add_to_carrier, at_carrier, motion_at_carrier};
use super::link::{add_joint_rate, joint_screws, with_zeros};
use super::place::WaterFrame;
use crate::lane::{Lane, Param};
use crate::lie::{Vector3, Vector6};
use crate::system::{BodyTerms, JOINTS, System};

/// Coordinates, rates and accelerations of the joints.
pub type JointMotion<'a, L> = [&'a [L; JOINTS]; 3];

/// Total wrench on the vehicle, fins and tether included, and total torque of each joint, friction and end stops included, at a
/// twist relative to the water and its rate, joint motion, and `gravity` (vehicle axes, m/s2).
#[inline(always)]
pub fn inverse_dynamics<L: Lane, P: Param<L>, B: Param<L>>(
    system: &System<P, B>,
    gravity: Vector3<L>,
    [twist, rate]: [Vector6<L>; 2],
    [q, qd, qdd]: JointMotion<L>,
    scratch: &mut Scratch<L>,
) -> (Vector6<L>, [L; JOINTS]) {
    let joints = system.chain();
    let Scratch { links, rates, .. } = scratch;
    let links = &mut links[..joints.len()];
    joint_screws(joints, true, q, links);
    let (mut g, mut V, mut A) = (gravity, twist, rate);
    for i in 0..joints.len() {
        if let Some(carrier) = joints[i].branch.carrier {
            cold_path();
            (g, V) = motion_at_carrier(carrier, (&WaterFrame::still(), L::zero()), (gravity, twist), links);
            A = at_carrier(carrier, Vector6::zero(), rate, rates);
        }
        let (joint, link) = (&joints[i], &mut links[i]);
        (g, V) = link.outward(joint, g, V, qd[i]);
        A = add_joint_rate(joint, link.twist_from_parent(joint, A) + with_zeros(link.c), qdd[i]);
        link.p = force(&joint.body, V, A, g);
        if joint.branch.forks {
            cold_path();
            (link.g, link.V, rates[i]) = (g, V, A);
        }
    }
    let (mut torques, mut children) = ([L::zero(); JOINTS], Vector6::zero());
    let mut on_vehicle = force(&system.vehicle, twist, rate, gravity);
    for i in (0..joints.len()).rev() {
        let (joint, link) = (&joints[i], &links[i]);
        let F = link.p + children;
        torques[i] = if joint.is_prismatic() { F.linear.0[2] } else { F.angular.0[2] };
        if let Some(inertia) = joint.rotor_inertia {
            torques[i] += inertia.get() * qdd[i];
        }
        children = link.wrench_to_parent(joint, F);
        if let Some(carrier) = joint.branch.carrier {
            cold_path();
            add_to_carrier(carrier, children, &mut on_vehicle, links);
            children = Vector6::zero();
        }
    }
    (on_vehicle + children, torques)
}

/// Wrench on a body beside weight, buoyancy and damping.
#[inline(always)]
fn force<L: Lane, B: Param<L>>(
    body: &BodyTerms<B>,
    twist: Vector6<L>,
    rate: Vector6<L>,
    gravity: Vector3<L>,
) -> Vector6<L> {
    let mut bias = Vector6::zero();
    body_bias::<_, _, false>(body, twist, gravity, &mut bias);
    bias + body.inertia.get().apply(rate)
}

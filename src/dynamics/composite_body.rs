//! Composite inertia, momentum and outer forces of vehicle and arm, in lanes: the prediction model of the controllers.
//!
//! Let h be the momentum (rigid and added) of all bodies, in vehicle axes at the vehicle's origin. For any motion of the
//! joints, `h' = f + F - V x* h` `[HC eq. 5, 22]` with weight, buoyancy and damping f, the wrench F of all other forces, and
//! `V x* h = [omega x p; v x p + omega x l]`.

#![allow(non_snake_case, reason = "twists carry their usual symbol")]

use std::hint::cold_path;

use super::aba::{Scratch, body_bias};
use super::link::{add_branch, add_to_carrier, joint_screws, motion_at_carrier, take_branches};
use crate::lane::{Lane, Param};
use crate::lie::{Vector3, Vector6};
use crate::spatial::SpatialInertia;
use crate::system::{JOINTS, System};

/// Vehicle and arm as one composite body, in vehicle axes at the vehicle's origin.
#[derive(Debug, Clone, Copy)]
pub struct CompositeBody<L> {
    /// Rigid and added inertia of all bodies at the present joint coordinates: the upper left block of M.
    pub inertia: SpatialInertia<L>,
    /// Momentum h: `inertia V` and the momentum of the joints' motion, N s and N m s.
    pub momentum: Vector6<L>,
    /// Wrench of weight, buoyancy and damping, N and N m.
    pub force: Vector6<L>,
}

impl<L: Lane> CompositeBody<L> {
    /// Composite of a system under `gravity` (vehicle axes, m/s2) whose vehicle has `twist` relative to the water. The
    /// vehicle's terms (fins, tether) are left out.
    #[inline(always)]
    pub fn of<P: Param<L>, B: Param<L>>(
        system: &System<P, B>,
        gravity: Vector3<L>,
        twist: Vector6<L>,
        (q, qd): (&[L; JOINTS], &[L; JOINTS]),
        scratch: &mut Scratch<L>,
    ) -> Self {
        let joints = system.chain();
        let Scratch { links, sums } = scratch;
        let links = &mut links[..joints.len()];
        joint_screws(joints, true, q, links);
        let (mut g, mut V) = (gravity, twist);
        for i in 0..joints.len() {
            if let Some(carrier) = joints[i].branch.carrier {
                cold_path();
                (g, V) = motion_at_carrier(carrier, (gravity, twist), links);
            }
            let (joint, link) = (&joints[i], &mut links[i]);
            (g, V) = link.outward(joint, g, V, qd[i]);
            (link.g, link.V) = (g, V);
            if joint.branch.forks {
                cold_path();
                link.p = Vector6::zero();
            }
        }
        let none = Self { inertia: SpatialInertia::zero(), momentum: Vector6::zero(), force: Vector6::zero() };
        let (mut composite, mut on_vehicle) = (none, Vector6::zero());
        for i in (0..joints.len()).rev() {
            let (joint, link) = (&joints[i], &links[i]);
            if joint.branch.forks {
                cold_path();
                (composite.inertia, composite.momentum) =
                    take_branches(sums, i + 1, &composite.inertia, composite.momentum);
                composite.force = composite.force + link.p;
            }
            composite.add(&joint.body, link.V, link.g);
            composite = Self {
                inertia: link.inertia_to_parent(joint, &composite.inertia),
                momentum: link.wrench_to_parent(joint, composite.momentum),
                force: link.wrench_to_parent(joint, composite.force),
            };
            if let Some(carrier) = joint.branch.carrier {
                cold_path();
                add_branch(sums, carrier, &composite.inertia, composite.momentum);
                add_to_carrier(carrier, composite.force, &mut on_vehicle, links);
                composite = none;
            }
        }
        if system.tree {
            cold_path();
            (composite.inertia, composite.momentum) = take_branches(sums, 0, &composite.inertia, composite.momentum);
            composite.force = composite.force + on_vehicle;
        }
        composite.add(&system.vehicle, twist, gravity);
        composite
    }

    /// Adds a body in the same frame.
    #[inline(always)]
    fn add<B: Param<L>>(&mut self, body: &crate::system::BodyTerms<B>, twist: Vector6<L>, gravity: Vector3<L>) {
        let inertia: SpatialInertia<L> = body.inertia.get();
        let mut bias = Vector6::zero();
        body_bias::<_, _, false>(body, twist, gravity, &mut bias);
        self.inertia = self.inertia.plus(&inertia);
        self.momentum = self.momentum + inertia.apply(twist);
        self.force = self.force + (inertia.bias_wrench(twist) - bias);
    }

    /// Momentum due to the joints' motion: `h - inertia V`, N s and N m s.
    #[inline(always)]
    pub fn joint_momentum(&self, twist: Vector6<L>) -> Vector6<L> {
        self.momentum - self.inertia.apply(twist)
    }

    /// `V x* h`, N and N m.
    #[inline(always)]
    pub fn momentum_transport(&self, twist: Vector6<L>) -> Vector6<L> {
        let (p, l) = (self.momentum.linear, self.momentum.angular);
        Vector6 { linear: twist.angular.cross(p), angular: twist.linear.cross_add(p, twist.angular.cross(l)) }
    }
}

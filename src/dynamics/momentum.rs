//! Momentum of a whole system and the forces that change it from outside, in lanes: what controllers predict by.
//!
//! With h the momentum (rigid and added) of all bodies in vehicle axes at the vehicle's origin, whatever the joints do
//! `h' = f + F - V x* h` `[HC eq. 5, 22]`: weight, buoyancy and drag f, the wrench F of all else, and
//! `V x* h = [omega x p; v x p + omega x l]`.

use super::articulated::{Scratch, body_bias, place};
use crate::lane::{Lane, Param};
use crate::lie::{Vector3, Vector6};
use crate::spatial::SpatialInertia;
use crate::system::{JOINTS, System};

/// A system as one body, in vehicle axes at the vehicle's origin.
#[derive(Debug, Clone, Copy)]
pub struct Whole<L> {
    /// Rigid and added inertia of all bodies as their joints stand: the first rows and columns of M.
    pub inertia: SpatialInertia<L>,
    /// `h = inertia V + arm`
    pub momentum: Vector6<L>,
    /// Weight, buoyancy and drag.
    pub force: Vector6<L>,
}

impl<L: Lane> Whole<L> {
    /// A system under gravity (vehicle axes) whose vehicle has this twist through the water. Fins and tethers do not
    /// count.
    #[inline(always)]
    pub fn of<P: Param<L>, B: Param<L>>(
        system: &System<P, B>,
        gravity: Vector3<L>,
        twist: Vector6<L>,
        (q, qd): (&[L; JOINTS], &[L; JOINTS]),
        scratch: &mut Scratch<L>,
    ) -> Self {
        let joints = system.chain();
        let links = &mut scratch.links[..joints.len()];
        place(joints, true, q, links);
        let (mut pull, mut moving) = (gravity, twist);
        for (i, (joint, link)) in joints.iter().zip(links.iter_mut()).enumerate() {
            (pull, moving) = link.outward(joint, pull, moving, qd[i]);
            (link.gravity, link.twist) = (pull, moving);
        }
        let mut all = Self { inertia: SpatialInertia::zero(), momentum: Vector6::zero(), force: Vector6::zero() };
        for (joint, link) in joints.iter().zip(links.iter()).rev() {
            all.join(&joint.body, link.twist, link.gravity);
            all = Self {
                inertia: link.inertia_to_parent(joint, &all.inertia),
                momentum: link.wrench_to_parent(joint, all.momentum),
                force: link.wrench_to_parent(joint, all.force),
            };
        }
        all.join(&system.vehicle, twist, gravity);
        all
    }

    /// Adds a body.
    #[inline(always)]
    fn join<B: Param<L>>(&mut self, body: &crate::system::BodyTerms<B>, twist: Vector6<L>, gravity: Vector3<L>) {
        let inertia: SpatialInertia<L> = body.inertia.get();
        let mut bias = Vector6::zero();
        body_bias::<_, _, false>(body, twist, gravity, &mut bias);
        self.inertia = self.inertia.plus(&inertia);
        self.momentum = self.momentum + inertia.apply(twist);
        self.force = self.force + (inertia.bias_wrench(twist) - bias);
    }

    /// Momentum of the joints' motion alone, with the vehicle of twist V at rest: `h - inertia V`.
    #[inline(always)]
    pub fn of_joints(&self, twist: Vector6<L>) -> Vector6<L> {
        self.momentum - self.inertia.apply(twist)
    }

    /// `V x* h`
    #[inline(always)]
    pub fn turning(&self, twist: Vector6<L>) -> Vector6<L> {
        let (p, l) = (self.momentum.linear, self.momentum.angular);
        Vector6 { linear: twist.angular.cross(p), angular: twist.linear.cross_add(p, twist.angular.cross(l)) }
    }
}

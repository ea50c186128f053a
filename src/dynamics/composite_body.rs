//! Composite inertia, momentum and outer forces of vehicle and arm, in lanes: the prediction model of the controllers.
//!
//! Let h be the momentum (rigid and added) of all bodies, in vehicle axes at the vehicle's origin. For any motion of the
//! joints, `h' = f + F - V x* h` `[HC eq. 5, 22]` with weight, buoyancy and damping f, the wrench F of all other forces, and
//! `V x* h = [omega x p; v x p + omega x l]`.

#![allow(non_snake_case, reason = "twists carry their usual symbol")]

use super::aba::{Scratch, body_bias};
use super::branches::motion_at_carrier;
use super::link::joint_screws;
use super::place::WaterFrame;
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
        if system.tree {
            Self::sum::<_, _, true>(system, gravity, twist, (q, qd), scratch)
        } else {
            Self::sum::<_, _, false>(system, gravity, twist, (q, qd), scratch)
        }
    }

    /// [`Self::of`], of a chain or of a `TREE`.
    #[inline(always)]
    fn sum<P: Param<L>, B: Param<L>, const TREE: bool>(
        system: &System<P, B>,
        gravity: Vector3<L>,
        twist: Vector6<L>,
        (q, qd): (&[L; JOINTS], &[L; JOINTS]),
        scratch: &mut Scratch<L>,
    ) -> Self {
        let joints = system.chain();
        let links = &mut scratch.links[..joints.len()];
        joint_screws(joints, true, q, links);
        let (mut g, mut V) = (gravity, twist);
        for i in 0..joints.len() {
            if let (true, Some(carrier)) = (TREE, joints[i].branch.carrier) {
                (g, V) = motion_at_carrier(carrier, (&WaterFrame::still(), L::zero()), (gravity, twist), links);
            }
            let (joint, link) = (&joints[i], &mut links[i]);
            (g, V) = link.outward(joint, g, V, qd[i]);
            (link.g, link.V) = (g, V);
        }
        let none = Self { inertia: SpatialInertia::zero(), momentum: Vector6::zero(), force: Vector6::zero() };
        let mut composite = none;
        // Of the branches on each body, vehicle first.
        let mut branches = [none; JOINTS + 1];
        for i in (0..joints.len()).rev() {
            let (joint, link) = (&joints[i], &links[i]);
            if TREE {
                composite = composite.plus(&branches[i + 1]);
            }
            composite.add(&joint.body, link.V, link.g);
            composite = Self {
                inertia: link.inertia_to_parent(joint, &composite.inertia),
                momentum: link.wrench_to_parent(joint, composite.momentum),
                force: link.wrench_to_parent(joint, composite.force),
            };
            if let (true, Some(carrier)) = (TREE, joint.branch.carrier) {
                if let Some(sum) = branches.get_mut(carrier as usize) {
                    *sum = sum.plus(&composite);
                }
                composite = none;
            }
        }
        if TREE {
            composite = composite.plus(&branches[0]);
        }
        composite.add(&system.vehicle, twist, gravity);
        composite
    }

    /// Sum of two composites in the same frame.
    #[inline(always)]
    fn plus(&self, other: &Self) -> Self {
        Self {
            inertia: self.inertia.plus(&other.inertia),
            momentum: self.momentum + other.momentum,
            force: self.force + other.force,
        }
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

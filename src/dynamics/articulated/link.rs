//! A link's place on its parent, and what the passes leave for each other.
//!
//! Joints that slide and stands that are whole poses are marked as rare, here and in the passes: the compiler then keeps
//! in registers what the others work with, and their way straight. A step takes 6 % less for that.

use std::hint::cold_path;

use super::{along, velocity_product};
use crate::lane::{Lane, Param};
use crate::lie::{Pose, Vector3, Vector6};
use crate::spatial::{SpatialInertia, constant_screw_z, screw_x, screw_z};
use crate::system::{JOINTS, JointPlacement, JointScrew, JointTerms};

/// What the passes leave for each other at a link.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Link<L> {
    /// Sine and cosine of theta; or d of a joint that slides.
    pub screw: [L; 2],
    /// Theta at the step's start, its sine and its cosine.
    pub start: [L; 3],
    /// Gravity in its axes.
    pub gravity: Vector3<L>,
    /// `U / D`. Along the joint it is 1, and not kept.
    pub share: Vector6<L>,
    /// V: for the implicit passes alone.
    pub twist: Vector6<L>,
    /// c, without the entries that vanish.
    pub across: [L; 4],
    /// p without what the links further out ask for.
    pub bias: Vector6<L>,
    /// `u / D`.
    pub torque: L,
}

/// Working memory of the passes.
#[derive(Debug, Clone)]
pub struct Scratch<L> {
    pub(crate) links: [Link<L>; JOINTS],
}

impl<L: Lane> Scratch<L> {
    /// Fresh memory; its contents never matter.
    pub fn new() -> Self {
        let (zero, none) = (L::zero(), Vector6::zero());
        let link = Link {
            screw: [zero; 2],
            start: [zero; 3],
            gravity: Vector3::zero(),
            share: none,
            twist: none,
            across: [zero; 4],
            bias: none,
            torque: zero,
        };
        Self { links: [link; JOINTS] }
    }
}

impl<L: Lane> Default for Scratch<L> {
    fn default() -> Self {
        Self::new()
    }
}

/// Does something with a joint's screw about its axis.
macro_rules! with_screw {
    ($link:expr, $joint:expr, |$screw:ident| $work:expr) => {
        match $joint.screw {
            JointScrew::Revolute { d } => {
                let $screw = screw_z($link.screw[0], $link.screw[1], d);
                $work
            }
            JointScrew::Prismatic { sin, cos } => {
                cold_path();
                let $screw = screw_z(sin, cos, Some($link.screw[0]));
                $work
            }
        }
    };
}

impl<L: Lane> Link<L> {
    /// Gravity and twist in this link's frame from those in its parent's; leaves c.
    #[inline(always)]
    pub fn outward<P: Param<L>, B>(
        &mut self,
        joint: &JointTerms<P, B>,
        gravity: Vector3<L>,
        twist: Vector6<L>,
        qd: L,
    ) -> (Vector3<L>, Vector6<L>) {
        let (gravity, twist) = self.both_from_parent(joint, gravity, twist);
        let twist = along(joint, twist, qd);
        self.across = velocity_product(joint.is_prismatic(), twist, qd);
        (gravity, twist)
    }

    /// A vector of the parent, in this link's axes, and a twist of the parent, in this link's frame.
    #[inline(always)]
    fn both_from_parent<P: Param<L>, B>(
        &self,
        joint: &JointTerms<P, B>,
        v: Vector3<L>,
        twist: Vector6<L>,
    ) -> (Vector3<L>, Vector6<L>) {
        let (v, twist) = joint.placement.both_from_parent(v, twist);
        with_screw!(self, joint, |screw| screw.both_from_parent(v, twist))
    }

    /// A twist of the parent, in this link's frame.
    #[inline(always)]
    pub fn twist_from_parent<P: Param<L>, B>(&self, joint: &JointTerms<P, B>, twist: Vector6<L>) -> Vector6<L> {
        let twist = joint.placement.twist_from_parent(twist);
        with_screw!(self, joint, |screw| screw.adjoint_apply_inverse(twist))
    }

    /// An inertia of this link, in the parent's frame.
    #[inline(always)]
    pub fn inertia_to_parent<P: Param<L>, B>(
        &self,
        joint: &JointTerms<P, B>,
        inertia: &SpatialInertia<L>,
    ) -> SpatialInertia<L> {
        joint.placement.inertia_to_parent(&with_screw!(self, joint, |screw| screw.inertia_to_parent(inertia)))
    }

    /// A wrench on this link, in the parent's frame.
    #[inline(always)]
    pub fn wrench_to_parent<P: Param<L>, B>(&self, joint: &JointTerms<P, B>, wrench: Vector6<L>) -> Vector6<L> {
        joint.placement.wrench_to_parent(with_screw!(self, joint, |screw| screw.co_adjoint_apply_inverse(wrench)))
    }
}

impl<P: Copy> JointPlacement<P> {
    /// A twist of the parent, in the joint's frame at zero.
    #[inline(always)]
    fn twist_from_parent<L: Lane>(&self, twist: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        match *self {
            JointPlacement::Dh(bend, a) => screw_x(bend, a).adjoint_apply_inverse(twist),
            JointPlacement::DhWithOffset(turn, d, bend, a) => {
                screw_x(bend, a).adjoint_apply_inverse(constant_screw_z(turn, d).adjoint_apply_inverse(twist))
            }
            JointPlacement::General(ref r, ref p) => {
                cold_path();
                Pose::of(r, p).adjoint_apply_inverse(twist)
            }
        }
    }

    /// A vector of the parent, in the joint's axes at zero, and a twist of the parent, in the joint's frame at zero.
    #[inline(always)]
    fn both_from_parent<L: Lane>(&self, v: Vector3<L>, twist: Vector6<L>) -> (Vector3<L>, Vector6<L>)
    where
        P: Param<L>,
    {
        match *self {
            JointPlacement::Dh(bend, a) => screw_x(bend, a).both_from_parent(v, twist),
            JointPlacement::DhWithOffset(turn, d, bend, a) => {
                let (v, twist) = constant_screw_z(turn, d).both_from_parent(v, twist);
                screw_x(bend, a).both_from_parent(v, twist)
            }
            JointPlacement::General(ref r, ref p) => {
                cold_path();
                let pose = Pose::of(r, p);
                (pose.rotation.apply_transposed(v), pose.adjoint_apply_inverse(twist))
            }
        }
    }

    /// An inertia in the joint's frame at zero, in the parent's.
    #[inline(always)]
    pub(super) fn inertia_to_parent<L: Lane>(&self, inertia: &SpatialInertia<L>) -> SpatialInertia<L>
    where
        P: Param<L>,
    {
        match *self {
            JointPlacement::Dh(bend, a) => screw_x(bend, a).inertia_to_parent(inertia),
            JointPlacement::DhWithOffset(turn, d, bend, a) => {
                constant_screw_z(turn, d).inertia_to_parent(&screw_x(bend, a).inertia_to_parent(inertia))
            }
            JointPlacement::General(ref r, ref p) => {
                cold_path();
                inertia.to_parent(&Pose::of(r, p))
            }
        }
    }

    /// A wrench in the joint's frame at zero, in the parent's.
    #[inline(always)]
    pub(super) fn wrench_to_parent<L: Lane>(&self, wrench: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        match *self {
            JointPlacement::Dh(bend, a) => screw_x(bend, a).co_adjoint_apply_inverse(wrench),
            JointPlacement::DhWithOffset(turn, d, bend, a) => {
                constant_screw_z(turn, d).co_adjoint_apply_inverse(screw_x(bend, a).co_adjoint_apply_inverse(wrench))
            }
            JointPlacement::General(ref r, ref p) => {
                cold_path();
                Pose::of(r, p).co_adjoint_apply_inverse(wrench)
            }
        }
    }
}

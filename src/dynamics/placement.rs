//! Transforms by the placement of a joint.

use std::hint::cold_path;

use crate::lane::{Lane, Param};
use crate::lie::{Pose, Vector3, Vector6};
use crate::spatial::{SpatialInertia, constant_screw_z, screw_x};
use crate::system::{Before, JointPlacement};

impl<P: Copy> JointPlacement<P> {
    /// Twist at the joint's frame at zero from the parent's.
    #[inline(always)]
    pub(super) fn twist_from_parent<L: Lane>(&self, mut twist: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        if let Some(before) = &self.before {
            cold_path();
            twist = before.twist_from_parent(twist);
        }
        screw_x(self.twist, self.a).adjoint_apply_inverse(twist)
    }

    /// Vector in the joint's axes at zero and twist at the joint's frame at zero, from the parent's.
    #[inline(always)]
    pub(super) fn both_from_parent<L: Lane>(&self, mut v: Vector3<L>, mut twist: Vector6<L>) -> (Vector3<L>, Vector6<L>)
    where
        P: Param<L>,
    {
        if let Some(before) = &self.before {
            cold_path();
            (v, twist) = before.both_from_parent(v, twist);
        }
        screw_x(self.twist, self.a).both_from_parent(v, twist)
    }

    /// Inertia in the parent's frame from the inertia in the joint's frame at zero.
    #[inline(always)]
    pub(super) fn inertia_to_parent<L: Lane>(&self, inertia: &SpatialInertia<L>) -> SpatialInertia<L>
    where
        P: Param<L>,
    {
        let inertia = screw_x(self.twist, self.a).inertia_to_parent(inertia);
        match &self.before {
            None => inertia,
            Some(before) => {
                cold_path();
                before.inertia_to_parent(&inertia)
            }
        }
    }

    /// Wrench at the parent's frame from the wrench at the joint's frame at zero.
    #[inline(always)]
    pub(super) fn wrench_to_parent<L: Lane>(&self, wrench: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let wrench = screw_x(self.twist, self.a).co_adjoint_apply_inverse(wrench);
        match &self.before {
            None => wrench,
            Some(before) => {
                cold_path();
                before.wrench_to_parent(wrench)
            }
        }
    }
}

impl<P: Copy> Before<P> {
    /// Twist after the transform from the twist before it.
    #[inline(always)]
    fn twist_from_parent<L: Lane>(&self, twist: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        match *self {
            Before::Screw(turn, d) => constant_screw_z(turn, d).adjoint_apply_inverse(twist),
            Before::Pose(ref r, ref p) => Pose::of(r, p).adjoint_apply_inverse(twist),
        }
    }

    /// Vector and twist after the transform from those before it.
    #[inline(always)]
    fn both_from_parent<L: Lane>(&self, v: Vector3<L>, twist: Vector6<L>) -> (Vector3<L>, Vector6<L>)
    where
        P: Param<L>,
    {
        match *self {
            Before::Screw(turn, d) => constant_screw_z(turn, d).both_from_parent(v, twist),
            Before::Pose(ref r, ref p) => {
                let pose = Pose::of(r, p);
                (pose.rotation.apply_transposed(v), pose.adjoint_apply_inverse(twist))
            }
        }
    }

    /// Inertia before the transform from the inertia after it.
    #[inline(always)]
    pub(super) fn inertia_to_parent<L: Lane>(&self, inertia: &SpatialInertia<L>) -> SpatialInertia<L>
    where
        P: Param<L>,
    {
        match *self {
            Before::Screw(turn, d) => constant_screw_z(turn, d).inertia_to_parent(inertia),
            Before::Pose(ref r, ref p) => inertia.to_parent(&Pose::of(r, p)),
        }
    }

    /// Wrench before the transform from the wrench after it.
    #[inline(always)]
    pub(super) fn wrench_to_parent<L: Lane>(&self, wrench: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        match *self {
            Before::Screw(turn, d) => constant_screw_z(turn, d).co_adjoint_apply_inverse(wrench),
            Before::Pose(ref r, ref p) => Pose::of(r, p).co_adjoint_apply_inverse(wrench),
        }
    }
}

//! A link's place on its parent, and what the passes leave for each other.

use crate::lane::{Lane, Param, get_option};
use crate::lie::{Pose, Vector3, Vector6};
use crate::spatial::{Factored, Screw, SpatialInertia, constant_screw_z, screw_x, screw_z};
use crate::system::{Constant, JOINTS, JointTerms, Stand};

/// What the passes leave for each other at a link.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Link<L> {
    /// Sine and cosine of theta; or d of a joint that slides.
    pub screw: [L; 2],
    /// Gravity in its axes.
    pub gravity: Vector3<L>,
    /// `U / D` and `1 / D`. Along the joint `U / D` is 1, and not kept.
    pub share: Vector6<L>,
    pub over_d: L,
    /// V: for the implicit passes alone.
    pub twist: Vector6<L>,
    /// c, without the entries that vanish.
    pub across: [L; 4],
    /// p without what the links further out ask for, later with `(A - U U^T / D) c`.
    pub bias: Vector6<L>,
    /// `u / D`.
    pub torque: L,
}

/// Working memory of the passes.
#[derive(Debug, Clone)]
pub struct Scratch<L> {
    pub(crate) links: [Link<L>; JOINTS],
    /// `A_0`, ready to be solved with.
    pub(crate) base: Factored<L>,
}

impl<L: Lane> Scratch<L> {
    /// Fresh memory; its contents never matter.
    pub fn new() -> Self {
        let (zero, none) = (L::zero(), Vector6::zero());
        let link = Link {
            screw: [zero; 2],
            gravity: Vector3::zero(),
            share: none,
            over_d: zero,
            twist: none,
            across: [zero; 4],
            bias: none,
            torque: zero,
        };
        Self { links: [link; JOINTS], base: Factored::blank() }
    }
}

impl<L: Lane> Default for Scratch<L> {
    fn default() -> Self {
        Self::new()
    }
}

impl<L: Lane> Link<L> {
    /// The screw about the joint's axis.
    #[inline(always)]
    pub fn screw<P: Param<L>>(&self, joint: &JointTerms<P>) -> Screw<L, 2> {
        match joint.constant {
            Constant::Shift(d) => screw_z(self.screw[0], self.screw[1], get_option(d)),
            Constant::Turn(sin, cos) => screw_z(sin.get(), cos.get(), Some(self.screw[0])),
        }
    }

    /// A vector of the parent, in this link's axes.
    #[inline(always)]
    pub fn rotate_back<P: Param<L>>(&self, joint: &JointTerms<P>, v: Vector3<L>) -> Vector3<L> {
        self.screw(joint).rotate_back(Base::of(&joint.stand).rotate_back(v))
    }

    /// A twist of the parent, in this link's frame.
    #[inline(always)]
    pub fn twist_from_parent<P: Param<L>>(&self, joint: &JointTerms<P>, twist: Vector6<L>) -> Vector6<L> {
        self.screw(joint).adjoint_apply_inverse(Base::of(&joint.stand).twist(twist))
    }

    /// An inertia of this link, in the parent's frame.
    #[inline(always)]
    pub fn inertia_to_parent<P: Param<L>>(
        &self,
        joint: &JointTerms<P>,
        inertia: &SpatialInertia<L>,
    ) -> SpatialInertia<L> {
        Base::of(&joint.stand).inertia(&self.screw(joint).inertia_to_parent(inertia))
    }

    /// A wrench on this link, in the parent's frame.
    #[inline(always)]
    pub fn wrench_to_parent<P: Param<L>>(&self, joint: &JointTerms<P>, wrench: Vector6<L>) -> Vector6<L> {
        Base::of(&joint.stand).wrench(self.screw(joint).co_adjoint_apply_inverse(wrench))
    }
}

/// The constant part of the move to a joint.
#[derive(Clone, Copy)]
pub(super) enum Base<L> {
    Bend(Screw<L, 0>),
    Crank(Screw<L, 2>, Screw<L, 0>),
    Pose(Pose<L>),
}

impl<L: Lane> Base<L> {
    #[inline(always)]
    pub fn of<P: Param<L>>(stand: &Stand<P>) -> Self {
        match *stand {
            Stand::Bend(bend, a) => Base::Bend(screw_x(bend, a)),
            Stand::Crank(turn, d, bend, a) => Base::Crank(constant_screw_z(turn, d), screw_x(bend, a)),
            Stand::Pose(ref r, ref p) => Base::Pose(Pose::of(r, p)),
        }
    }

    #[inline(always)]
    pub fn twist(&self, twist: Vector6<L>) -> Vector6<L> {
        match self {
            Base::Bend(x) => x.adjoint_apply_inverse(twist),
            Base::Crank(z, x) => x.adjoint_apply_inverse(z.adjoint_apply_inverse(twist)),
            Base::Pose(pose) => pose.adjoint_apply_inverse(twist),
        }
    }

    #[inline(always)]
    pub fn rotate_back(&self, v: Vector3<L>) -> Vector3<L> {
        match self {
            Base::Bend(x) => x.rotate_back(v),
            Base::Crank(z, x) => x.rotate_back(z.rotate_back(v)),
            Base::Pose(pose) => pose.rotation.apply_transposed(v),
        }
    }

    #[inline(always)]
    pub fn inertia(&self, inertia: &SpatialInertia<L>) -> SpatialInertia<L> {
        match self {
            Base::Bend(x) => x.inertia_to_parent(inertia),
            Base::Crank(z, x) => z.inertia_to_parent(&x.inertia_to_parent(inertia)),
            Base::Pose(pose) => inertia.to_parent(pose),
        }
    }

    #[inline(always)]
    pub fn wrench(&self, wrench: Vector6<L>) -> Vector6<L> {
        match self {
            Base::Bend(x) => x.co_adjoint_apply_inverse(wrench),
            Base::Crank(z, x) => z.co_adjoint_apply_inverse(x.co_adjoint_apply_inverse(wrench)),
            Base::Pose(pose) => pose.co_adjoint_apply_inverse(wrench),
        }
    }
}

//! Common joints ([`crate::system::JointKind`]): their whole transform is a screw about x and one about z, and each kind has machine
//! code of its own, which tests nothing further.

use super::link::{LinkScratch, velocity_product};
use crate::lane::{Lane, Param};
use crate::lie::{Vector3, Vector6};
use crate::spatial::{LinkTwist, Screw, screw_x, screw_z};
use crate::system::JointTerms;

/// Link twist, a and d of a revolute joint, to be read where they are used.
pub(super) type DhParameters<'a, P> = (&'a LinkTwist<P>, Option<&'a P>, Option<&'a P>);

/// [`DhParameters`] of a revolute joint.
#[inline(always)]
pub(super) fn dh_parameters<P, B>(joint: &JointTerms<P, B>) -> DhParameters<'_, P> {
    (&joint.placement.twist, joint.placement.a.as_ref(), joint.screw.d.as_ref())
}

/// (Not `copied`, which would remain a call.)
#[allow(clippy::manual_map, reason = "a closure would not inherit the caller's instruction set")]
#[inline(always)]
fn read<P: Copy>(parameter: Option<&P>) -> Option<P> {
    match parameter {
        Some(parameter) => Some(*parameter),
        None => None,
    }
}

/// Evaluates `$work` with the parameters of a common joint, for each kind by itself unless `$one_form`; nothing for another joint.
macro_rules! if_common {
    ($one_form:expr, $joint:expr, |$parameters:ident| $work:expr) => {
        match &$joint.kind {
            JointKind::Other => {}
            _ if $one_form => {
                let $parameters = dh_parameters($joint);
                $work
            }
            JointKind::Parallel(a) => {
                let $parameters = (&LinkTwist::Deg0, Some(a), None);
                $work
            }
            JointKind::Opposite(a) => {
                let $parameters = (&LinkTwist::Deg180, Some(a), None);
                $work
            }
            JointKind::Perpendicular => {
                let $parameters = (&LinkTwist::Deg90, None, None);
                $work
            }
            JointKind::PerpendicularApart(a) => {
                let $parameters = (&LinkTwist::Deg90, Some(a), None);
                $work
            }
            JointKind::Common => {
                let $parameters = dh_parameters($joint);
                $work
            }
        }
    };
}
pub(super) use if_common;

impl<L: Lane> LinkScratch<L> {
    /// Screws of a revolute joint about x and z.
    #[inline(always)]
    pub fn screws<P: Copy>(&self, &(twist, a, d): &DhParameters<P>) -> (Screw<P, P, 0>, Screw<L, P, 2>) {
        (screw_x(*twist, read(a)), screw_z(self.screw[0], self.screw[1], read(d)))
    }

    /// [`Self::outward`] across a common joint.
    #[inline(always)]
    pub fn outward_common<P: Param<L>>(
        &mut self,
        parameters: &DhParameters<P>,
        gravity: Vector3<L>,
        twist: Vector6<L>,
        qd: L,
    ) -> (Vector3<L>, Vector6<L>) {
        let (x, z) = self.screws(parameters);
        let (gravity, twist) = x.both_from_parent(gravity, twist);
        let (gravity, mut twist) = z.both_from_parent(gravity, twist);
        twist.angular.0[2] += qd;
        self.c = velocity_product(false, twist, qd);
        (gravity, twist)
    }
}

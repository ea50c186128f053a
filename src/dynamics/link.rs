//! Transforms between a link and its parent, and the link's intermediate results of the passes of [`super::aba`].
//!
//! Prismatic joints and general placements are marked as cold paths, here and in the passes: the compiler then keeps the
//! operands of the other cases in registers and their code contiguous. A step takes 6 % less time for it.

#![allow(non_snake_case, reason = "fields carry the symbols of the articulated-body algorithm")]

use std::hint::{black_box, cold_path};

use super::articulation::Outer;
use super::branches::Branches;
use super::contact::ContactScratch;
use super::place::WaterFrame;
use crate::lane::{Lane, Param, is_far, sin_cos, sin_cos_beyond, sin_cos_near};
use crate::lie::{Vector3, Vector6};
use crate::spatial::{SpatialInertia, screw_z};
use crate::system::{JOINTS, JointTerms};

/// Intermediate results of the passes at a link.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LinkScratch<L> {
    /// Sine and cosine of theta of a revolute joint; d of a prismatic one, m.
    pub screw: [L; 2],
    /// Theta at the start of the step, its sine and its cosine.
    pub start: [L; 3],
    /// Gravity in link axes, m/s2; set by the implicit passes, and where joints branch off.
    pub g: Vector3<L>,
    /// `U / D`. The explicit form does not use its component along the joint, `1 - J / D`.
    pub U_over_D: Vector6<L>,
    /// `J / D` with the inertia J of the joint's rotor, if it has one.
    pub J_over_D: L,
    /// Inertia about or along the joint, without what an implicit step adds for the joint's forces; set by the implicit passes only.
    pub along: L,
    /// Twist relative to the water, then its rate; set by the implicit passes, and where joints branch off.
    pub V: Vector6<L>,
    /// `c = ad_V E q'` without its vanishing entries: x and y of the linear and of the angular part.
    pub c: [L; 4],
    /// Bias wrench of the link without the contribution of the outer links.
    pub p: Vector6<L>,
    /// `u / D`.
    pub u_over_D: L,
}

impl<L: Lane> LinkScratch<L> {
    /// Zeros.
    #[inline(always)]
    pub fn new() -> Self {
        let (zero, none) = (L::zero(), Vector6::zero());
        Self {
            screw: [zero; 2],
            start: [zero; 3],
            g: Vector3::zero(),
            U_over_D: none,
            J_over_D: zero,
            along: zero,
            V: none,
            c: [zero; 4],
            p: none,
            u_over_D: zero,
        }
    }
}

/// Drive of a joint.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Drive<L> {
    /// Torque, and a damping that adds to D.
    Torque { tau: L, damping: Option<L> },
    /// Prescribed acceleration.
    Acceleration(L),
}

/// Working memory of the passes.
#[derive(Debug, Clone)]
pub struct Scratch<L> {
    pub(crate) links: [LinkScratch<L>; JOINTS],
    /// Sums of branches; only trees use them.
    pub(super) branches: Branches<L>,
    /// Inertia and bias wrench of the outer links.
    pub(super) outer: Outer<L>,
    /// Rates of the twists of links that carry branches; inverse dynamics only.
    pub(super) rates: [Vector6<L>; JOINTS],
    /// Wrenches of contacts; only scenes with contact use them.
    pub contact: ContactScratch<L>,
    /// The water, for the world.
    pub water: WaterFrame<L>,
}

impl<L: Lane> Scratch<L> {
    /// Zeros. No pass reads an entry before it has written it.
    pub fn new() -> Self {
        // Copied from memory: number by number it would take 40 kB of machine code for each kind of lanes.
        let (link, none) = (black_box(LinkScratch::new()), Vector6::zero());
        let (branches, contact, water) = (Branches::new(), ContactScratch::new(), WaterFrame::still());
        Self { links: [link; JOINTS], branches, outer: Outer::zero(), rates: [none; JOINTS], contact, water }
    }

    /// Inertia about or along joint `i` at the last implicit pass.
    #[inline(always)]
    pub fn inertia(&self, i: usize) -> L {
        self.links[i].along
    }
}

impl<L: Lane> Default for Scratch<L> {
    #[inline(always)]
    fn default() -> Self {
        Self::new()
    }
}

/// `c = ad_V E q'`: `[v x e_z; omega x e_z] q'` of a revolute joint, `[omega x e_z; 0] q'` of a prismatic one; x and y of
/// both parts, the others vanish.
#[inline(always)]
pub(super) fn velocity_product<L: Lane>(prismatic: bool, twist: Vector6<L>, qd: L) -> [L; 4] {
    let (v, w) = (twist.linear.0, twist.angular.0);
    let (x, y) = (w[1] * qd, -(w[0] * qd));
    if prismatic {
        cold_path();
        return [x, y, L::zero(), L::zero()];
    }
    [v[1] * qd, -(v[0] * qd), x, y]
}

/// c as a 6-vector, its vanishing entries included.
#[inline(always)]
pub(super) fn with_zeros<L: Lane>([vx, vy, wx, wy]: [L; 4]) -> Vector6<L> {
    Vector6 { linear: Vector3([vx, vy, L::zero()]), angular: Vector3([wx, wy, L::zero()]) }
}

/// `V + E q'`
#[inline(always)]
pub(super) fn add_joint_rate<L: Lane, P: Copy, B>(
    joint: &JointTerms<P, B>,
    mut twist: Vector6<L>,
    qd: L,
) -> Vector6<L> {
    if joint.is_prismatic() {
        cold_path();
        twist.linear.0[2] += qd;
    } else {
        twist.angular.0[2] += qd;
    }
    twist
}

/// Sets `screw` of each link from the joint coordinates. Within a step, sine and cosine are computed from their values at its
/// start, which are near.
#[inline(always)]
pub(super) fn joint_screws<L: Lane, P: Param<L>, B>(
    joints: &[JointTerms<P, B>],
    is_start: bool,
    q: &[L; JOINTS],
    links: &mut [LinkScratch<L>],
) {
    let n = joints.len().min(links.len());
    if is_start {
        for i in 0..n {
            let (joint, link) = (&joints[i], &mut links[i]);
            let coordinate = joint.offset.get() + q[i];
            let (sin, cos) = sin_cos(coordinate);
            link.start = [coordinate, sin, cos];
            link.screw = [sin, cos];
            if joint.is_prismatic() {
                cold_path();
                link.screw = [coordinate; 2];
            }
        }
        return;
    }
    let mut farthest = L::zero();
    for i in 0..n {
        let (joint, link) = (&joints[i], &mut links[i]);
        let coordinate = joint.offset.get() + q[i];
        let (near, square) = sin_cos_near(coordinate, link.start);
        link.screw = near;
        farthest = square.max(farthest);
        if joint.is_prismatic() {
            cold_path();
            link.screw = [coordinate; 2];
        }
    }
    if L::any(is_far(farthest)) {
        cold_path();
        for i in 0..n {
            let (joint, link) = (&joints[i], &mut links[i]);
            if !joint.is_prismatic() {
                link.screw = sin_cos_beyond(joint.offset.get() + q[i], link.start, link.screw);
            }
        }
    }
}

/// Evaluates `$work` with the joint's screw about its axis.
macro_rules! with_screw {
    ($link:expr, $joint:expr, |$screw:ident| $work:expr) => {
        if let Some([sin, cos]) = $joint.screw.theta {
            cold_path();
            let $screw = screw_z(sin, cos, Some($link.screw[0]));
            $work
        } else {
            let $screw = screw_z($link.screw[0], $link.screw[1], $joint.screw.d);
            $work
        }
    };
}

impl<L: Lane> LinkScratch<L> {
    /// Rate of the link's twist and acceleration of its joint, from the rate of its parent's twist at its frame.
    #[inline(always)]
    pub fn accelerate(&self, parent: Vector6<L>, prismatic: bool, geared: bool) -> (Vector6<L>, L) {
        let ([mut vx, mut vy, vz], [mut wx, mut wy, wz]) = (parent.linear.0, parent.angular.0);
        (vx, vy) = (vx + self.c[0], vy + self.c[1]);
        (wx, wy) = (wx + self.c[2], wy + self.c[3]);
        let ([sx, sy, sz], [tx, ty, tz]) = (self.U_over_D.linear.0, self.U_over_D.angular.0);
        // The link's acceleration along its joint is `(u - U^T ...) / D`, independent of the parent's there. Two partial sums,
        // starting with the component that the joint's rotation leaves unchanged: this is the latency chain of the pass.
        let first = if prismatic {
            cold_path();
            tz.neg_mul_add(wz, self.u_over_D)
        } else {
            sz.neg_mul_add(vz, self.u_over_D)
        };
        let along = tx.neg_mul_add(wx, sx.neg_mul_add(vx, first)) - ty.mul_add(wy, sy * vy);
        // Both entries are bound anew: a reference to one of them would send both through memory.
        let (vz, wz, qdd) = if prismatic {
            cold_path();
            let along = if geared { self.J_over_D.mul_add(vz, along) } else { along };
            (along, wz, along - vz)
        } else {
            let along = if geared { self.J_over_D.mul_add(wz, along) } else { along };
            (vz, along, along - wz)
        };
        (Vector6 { linear: Vector3([vx, vy, vz]), angular: Vector3([wx, wy, wz]) }, qdd)
    }

    /// Gravity and twist in this link's frame from gravity and twist in its parent's; sets c.
    #[inline(always)]
    pub fn outward<P: Param<L>, B>(
        &mut self,
        joint: &JointTerms<P, B>,
        gravity: Vector3<L>,
        twist: Vector6<L>,
        qd: L,
    ) -> (Vector3<L>, Vector6<L>) {
        let (gravity, twist) = joint.placement.both_from_parent(gravity, twist);
        let (gravity, twist) = with_screw!(self, joint, |screw| screw.both_from_parent(gravity, twist));
        let twist = add_joint_rate(joint, twist, qd);
        self.c = velocity_product(joint.is_prismatic(), twist, qd);
        (gravity, twist)
    }

    /// Twist at this link's frame from the parent's.
    #[inline(always)]
    pub fn twist_from_parent<P: Param<L>, B>(&self, joint: &JointTerms<P, B>, twist: Vector6<L>) -> Vector6<L> {
        let twist = joint.placement.twist_from_parent(twist);
        with_screw!(self, joint, |screw| screw.adjoint_apply_inverse(twist))
    }

    /// Inertia in the parent's frame from the inertia in this link's.
    #[inline(always)]
    pub fn inertia_to_parent<P: Param<L>, B>(
        &self,
        joint: &JointTerms<P, B>,
        inertia: &SpatialInertia<L>,
    ) -> SpatialInertia<L> {
        joint.placement.inertia_to_parent(&with_screw!(self, joint, |screw| screw.inertia_to_parent(inertia)))
    }

    /// Articulated inertia I_a and bias wrench p_a in this link's frame, from its I_A and p_A, under the torque `tau` of a revolute
    /// joint with a rotor of inertia `J`. Sets U, u and J over D.
    #[inline(always)]
    pub fn free(&mut self, I_A: &SpatialInertia<L>, p_A: Vector6<L>, J: L, tau: L) -> (SpatialInertia<L>, Vector6<L>) {
        let U = I_A.column::<5>();
        let one_over_D = L::c(1.0) / (U.angular.0[2] + J);
        (self.J_over_D, self.u_over_D) = (J * one_over_D, (tau - p_A.angular.0[2]) * one_over_D);
        self.U_over_D = U.scale(one_over_D);
        let I_a = I_A.eliminated(U, one_over_D);
        (I_a, I_a.apply(with_zeros(self.c)) + U.scale_add(self.u_over_D, p_A))
    }

    /// Articulated inertia I_a and bias wrench p_a in the parent's frame, from I_A and p_A of this link and the drive of its joint.
    /// Sets U, u and J over D. A prescribed acceleration is the limit of an infinite J.
    #[inline(always)]
    pub fn eliminate<P: Param<L>, B>(
        &mut self,
        joint: &JointTerms<P, B>,
        I_A: &SpatialInertia<L>,
        p_A: Vector6<L>,
        drive: Drive<L>,
    ) -> (SpatialInertia<L>, Vector6<L>) {
        let (U, along, p_along) = if joint.is_prismatic() {
            let U = I_A.column::<2>();
            (U, U.linear.0[2], p_A.linear.0[2])
        } else {
            let U = I_A.column::<5>();
            (U, U.angular.0[2], p_A.angular.0[2])
        };
        let one_over_D;
        (one_over_D, self.J_over_D, self.u_over_D) = match drive {
            Drive::Torque { tau, damping } => {
                let mut D = damping.map_or(along, |damping| along + damping);
                let J = joint.rotor_inertia.map_or_else(L::zero, |inertia| inertia.get());
                if damping.is_some() {
                    self.along = along + J;
                }
                if joint.rotor_inertia.is_some() {
                    D += J;
                }
                let one_over_D = L::c(1.0) / D;
                (one_over_D, J * one_over_D, (tau - p_along) * one_over_D)
            }
            Drive::Acceleration(acceleration) => (L::zero(), L::c(1.0), acceleration),
        };
        self.U_over_D = U.scale(one_over_D);
        let I_a = I_A.eliminated(U, one_over_D);
        let p_a = I_a.apply(with_zeros(self.c)) + U.scale_add(self.u_over_D, p_A);
        (self.inertia_to_parent(joint, &I_a), self.wrench_to_parent(joint, p_a))
    }

    /// Wrench at the parent's frame from the wrench on this link.
    #[inline(always)]
    pub fn wrench_to_parent<P: Param<L>, B>(&self, joint: &JointTerms<P, B>, wrench: Vector6<L>) -> Vector6<L> {
        joint.placement.wrench_to_parent(with_screw!(self, joint, |screw| screw.co_adjoint_apply_inverse(wrench)))
    }
}

//! Articulated inertia and bias wrench across a joint, from its link to the parent: `I_a = I_A - U U^T / D` and
//! `p_a = p_A + I_a c + U u / D` of [`super::aba`], in the parent's frame.
//!
//! [`Outer::across`] takes one step after the other on the whole inertia. Across a geared joint, with 16 registers, most numbers
//! would go through the stack at each step. There the inertia is in memory, and each of its three blocks is read, changed by all
//! steps and written before the next one is read ([`Outer::across_geared`]): the same bits by half as many loads and stores.

#![allow(non_snake_case, reason = "inertias and wrenches carry the symbols of the articulated-body algorithm")]

use std::hint::cold_path;

use super::aba::ArmLoads;
use super::link::{Drive, LinkScratch, with_zeros};
use crate::lane::{Lane, Param, separate, unroll};
use crate::lie::{Pose, Vector6};
use crate::spatial::{EarlierBlocks, LinkTwist, Screw, SpatialInertia, constant_screw_z, screw_x, screw_z};
use crate::system::{JointPlacement, JointScrew, JointTerms};

/// Inertia and bias wrench that the outer links add to a body, in its frame.
#[derive(Debug, Clone)]
pub(crate) struct Outer<L> {
    pub inertia: SpatialInertia<L>,
    pub p: Vector6<L>,
    /// Numbers for later blocks: of the joint's screw and of its placement; contributions of earlier blocks to `I_a c`.
    of_screw: EarlierBlocks<L>,
    of_placement: EarlierBlocks<L>,
    force: [L; 3],
    moment: [L; 3],
}

impl<L: Lane> Outer<L> {
    /// Zeros.
    #[inline(always)]
    pub fn zero() -> Self {
        let (none, zero) = (EarlierBlocks::zero(), [L::zero(); 3]);
        let (of_screw, of_placement) = (none, none);
        Self { inertia: SpatialInertia::zero(), p: Vector6::zero(), of_screw, of_placement, force: zero, moment: zero }
    }

    /// Goes from the outer links of this link to those of its parent, under the torque `tau` or the prescribed acceleration of joint
    /// `i` at a time. Sets U, u and J over D of the link. Without `GEARED` no joint of the system has a rotor.
    #[inline(always)]
    pub fn across<P: Param<L>, B: Param<L>, const SPARSE: bool, const GEARED: bool>(
        &mut self,
        joint: &JointTerms<P, B>,
        tau: L,
        (loads, i, time): (&ArmLoads<L>, usize, L),
        link: &mut LinkScratch<L>,
    ) {
        let I_A = self.inertia.plus_own::<_, SPARSE>(&joint.body.inertia);
        let mut p = link.p + self.p;
        if GEARED && joint.rotor_inertia.is_some() {
            let drive = if joint.prescribed {
                cold_path();
                Drive::Acceleration(loads.target_acceleration(i, time))
            } else {
                Drive::Torque { tau, damping: None }
            };
            (self.inertia, self.p) = link.eliminate(joint, &I_A, p, drive);
            return;
        }
        // Along its axis a joint without a rotor transmits its torque only.
        let (I_a, p_a) = match joint.screw {
            JointScrew::Revolute { d } => {
                let screw = screw_z(link.screw[0], link.screw[1], d);
                let (I_a, U_over_D, one_over_D) = I_A.eliminate_revolute();
                link.U_over_D.linear = U_over_D.linear;
                (link.U_over_D.angular.0[0], link.U_over_D.angular.0[1]) =
                    (U_over_D.angular.0[0], U_over_D.angular.0[1]);
                let u = tau - p.angular.0[2];
                link.u_over_D = u * one_over_D;
                I_a.apply_across(link.c, &mut p);
                p = U_over_D.scale_add(u, p);
                p.angular.0[2] = tau;
                (screw.revolute_inertia_to_parent(&I_a), screw.co_adjoint_apply_inverse(p))
            }
            JointScrew::Prismatic { sin, cos } => {
                cold_path();
                let screw = screw_z(sin, cos, Some(link.screw[0]));
                let (I_a, U_over_D, one_over_D) = I_A.eliminate_prismatic();
                link.U_over_D = U_over_D;
                let u = tau - p.linear.0[2];
                link.u_over_D = u * one_over_D;
                p = U_over_D.scale_add(u, I_a.apply(with_zeros(link.c)) + p);
                p.linear.0[2] = tau;
                (screw.inertia_to_parent(&I_a), screw.co_adjoint_apply_inverse(p))
            }
        };
        (self.inertia, self.p) = (joint.placement.inertia_to_parent(&I_a), joint.placement.wrench_to_parent(p_a));
    }

    /// [`Self::across`] a revolute joint with offset `d` and a rotor of inertia `J` that is not prescribed.
    #[inline(always)]
    pub fn across_geared<P: Param<L>, B: Param<L>, const SPARSE: bool>(
        &mut self,
        joint: &JointTerms<P, B>,
        d: Option<P>,
        J: L,
        tau: L,
        link: &mut LinkScratch<L>,
    ) {
        let (bend, a) = match joint.placement {
            JointPlacement::Dh(bend, a) | JointPlacement::DhWithOffset(_, _, bend, a) => (bend, a),
            JointPlacement::General(..) => (LinkTwist::Deg0, None),
        };
        let (own, z, x) = (&joint.body.inertia, screw_z(link.screw[0], link.screw[1], d), screw_x(bend, a));
        self.column::<_, SPARSE>(own, J, tau, link);
        separate();
        self.linear::<_, _, SPARSE>(own, &z, &x, link);
        separate();
        self.coupling::<_, _, SPARSE>(own, &z, &x, link);
        separate();
        self.angular::<_, _, SPARSE>(own, &z, &x, link);
        separate();
        let p = x.co_adjoint_apply_inverse(z.co_adjoint_apply_inverse(self.p));
        match joint.placement {
            JointPlacement::Dh(..) => self.p = p,
            JointPlacement::DhWithOffset(turn, d, ..) => {
                let turned = constant_screw_z(turn, d);
                self.p = turned.co_adjoint_apply_inverse(p);
                self.inertia = turned.inertia_to_parent(&self.inertia);
            }
            JointPlacement::General(ref r, ref at) => {
                cold_path();
                let pose = Pose::of(r, at);
                self.p = pose.co_adjoint_apply_inverse(p);
                self.inertia = self.inertia.to_parent(&pose);
            }
        }
    }

    /// Column U of I_A, which stays in the inertia; `p_A + U u / D`.
    #[inline(always)]
    fn column<B: Param<L>, const SPARSE: bool>(
        &mut self,
        own: &SpatialInertia<B>,
        J: L,
        tau: L,
        link: &mut LinkScratch<L>,
    ) {
        let SpatialInertia { h, j, .. } = &mut self.inertia;
        h[0][2] += own.h[0][2].get();
        h[1][2] += own.h[1][2].get();
        j[2] += own.j[2].get();
        j[5] += own.j[5].get();
        if !SPARSE {
            h[2][2] += own.h[2][2].get();
            j[4] += own.j[4].get();
        }
        let U = Vector6::from_array([h[0][2], h[1][2], h[2][2], j[2], j[4], j[5]]);
        let p = link.p + self.p;
        let one_over_D = L::c(1.0) / (j[5] + J);
        link.J_over_D = J * one_over_D;
        link.u_over_D = (tau - p.angular.0[2]) * one_over_D;
        link.U_over_D = U.scale(one_over_D);
        self.p = U.scale_add(link.u_over_D, p);
    }

    /// Linear block.
    #[inline(always)]
    fn linear<P: Param<L>, B: Param<L>, const SPARSE: bool>(
        &mut self,
        own: &SpatialInertia<B>,
        z: &Screw<L, P, 2>,
        x: &Screw<P, P, 0>,
        link: &LinkScratch<L>,
    ) {
        let (mut m, h, s) = (self.inertia.m, &self.inertia.h, &link.U_over_D.linear.0);
        unroll!(k in 0 1 2 3 4 5 => {
            if !SPARSE || k == 0 || k == 3 || k == 5 {
                m[k] += own.m[k].get();
            }
        });
        m[0] = s[0].neg_mul_add(h[0][2], m[0]);
        m[1] = s[0].neg_mul_add(h[1][2], m[1]);
        m[2] = s[0].neg_mul_add(h[2][2], m[2]);
        m[3] = s[1].neg_mul_add(h[1][2], m[3]);
        m[4] = s[1].neg_mul_add(h[2][2], m[4]);
        m[5] = s[2].neg_mul_add(h[2][2], m[5]);
        // c has no components along and about the joint.
        let [x_rate, y_rate, ..] = link.c;
        self.force[0] = m[1].mul_add(y_rate, m[0] * x_rate);
        self.force[1] = m[3].mul_add(y_rate, m[1] * x_rate);
        self.force[2] = m[4].mul_add(y_rate, m[2] * x_rate);
        let m = z.linear_to_parent(&m, &mut self.of_screw);
        self.inertia.m = x.linear_to_parent(&m, &mut self.of_placement);
    }

    /// Coupling block.
    #[inline(always)]
    fn coupling<P: Param<L>, B: Param<L>, const SPARSE: bool>(
        &mut self,
        own: &SpatialInertia<B>,
        z: &Screw<L, P, 2>,
        x: &Screw<P, P, 0>,
        link: &LinkScratch<L>,
    ) {
        let (mut h, j, s) = (self.inertia.h, &self.inertia.j, &link.U_over_D.linear.0);
        let [x_rate, y_rate, x_turn, y_turn] = link.c;
        let p = &mut self.p.linear.0;
        unroll!(i in 0 1 2 => {
            if !SPARSE || i != 0 {
                h[i][0] += own.h[i][0].get();
            }
            if !SPARSE || i != 1 {
                h[i][1] += own.h[i][1].get();
            }
            h[i][0] = s[i].neg_mul_add(j[2], h[i][0]);
            h[i][1] = s[i].neg_mul_add(j[4], h[i][1]);
            h[i][2] = s[i].neg_mul_add(j[5], h[i][2]);
            p[i] = (self.force[i] + h[i][1].mul_add(y_turn, h[i][0] * x_turn)) + p[i];
        });
        unroll!(k in 0 1 2 => {
            self.moment[k] = h[1][k].mul_add(y_rate, h[0][k] * x_rate);
        });
        let h = z.coupling_to_parent(&h, &mut self.of_screw);
        self.inertia.h = x.coupling_to_parent(&h, &mut self.of_placement);
    }

    /// Angular block.
    #[inline(always)]
    fn angular<P: Param<L>, B: Param<L>, const SPARSE: bool>(
        &mut self,
        own: &SpatialInertia<B>,
        z: &Screw<L, P, 2>,
        x: &Screw<P, P, 0>,
        link: &LinkScratch<L>,
    ) {
        let (mut j, s) = (self.inertia.j, &link.U_over_D.angular.0);
        let t = [j[2], j[4], j[5]];
        j[0] += own.j[0].get();
        j[3] += own.j[3].get();
        if !SPARSE {
            j[1] += own.j[1].get();
        }
        j[0] = s[0].neg_mul_add(t[0], j[0]);
        j[1] = s[0].neg_mul_add(t[1], j[1]);
        j[2] = s[0].neg_mul_add(t[2], j[2]);
        j[3] = s[1].neg_mul_add(t[1], j[3]);
        j[4] = s[1].neg_mul_add(t[2], j[4]);
        j[5] = s[2].neg_mul_add(t[2], j[5]);
        let [_, _, x_turn, y_turn] = link.c;
        let p = &mut self.p.angular.0;
        p[0] = (j[1].mul_add(y_turn, j[0] * x_turn) + self.moment[0]) + p[0];
        p[1] = (j[3].mul_add(y_turn, j[1] * x_turn) + self.moment[1]) + p[1];
        p[2] = (j[4].mul_add(y_turn, j[2] * x_turn) + self.moment[2]) + p[2];
        let j = z.angular_to_parent(&j, &self.of_screw);
        self.inertia.j = x.angular_to_parent(&j, &self.of_placement);
    }
}

//! Articulated inertia and bias wrench across a joint, from its link to the parent: `I_a = I_A - U U^T / D` and
//! `p_a = p_A + I_a c + U u / D` of [`super::aba`], in the parent's frame.
//!
//! [`Outer::across`] takes one step after the other on the whole inertia. Across a geared joint, with 16 registers, most numbers
//! would go through the stack at each step. There the inertia is in memory, and each of its three blocks is read, changed by all
//! steps and written before the next one is read ([`Outer::across_geared`]): the same bits by half as many loads and stores.

#![allow(non_snake_case, reason = "inertias and wrenches carry the symbols of the articulated-body algorithm")]

use std::hint::cold_path;

use super::aba::ArmLoads;
use super::branches::Branches;
use super::common_joint::{DhParameters, dh_parameters};
use super::link::{Drive, LinkScratch, with_zeros};
use crate::lane::{Lane, Param, Routine, separate, unroll};
use crate::lie::Vector6;
use crate::spatial::{EarlierBlocks, SpatialInertia, screw_z};
use crate::system::JointTerms;

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
        let by_blocks = GEARED && !L::MANY_REGISTERS && !joint.is_prismatic() && !joint.prescribed;
        if let (true, Some(J)) = (by_blocks, joint.rotor_inertia) {
            self.across_geared::<_, _, SPARSE>(joint, &dh_parameters(joint), J.get(), tau, link);
            if let Some(before) = &joint.placement.before {
                self.inertia = before.inertia_to_parent(&self.inertia);
                self.p = before.wrench_to_parent(self.p);
            }
            return;
        }
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
        let (I_a, p_a) = if let Some([sin, cos]) = joint.screw.theta {
            cold_path();
            let screw = screw_z(sin, cos, Some(link.screw[0]));
            let (I_a, U_over_D, one_over_D) = I_A.eliminate_prismatic();
            link.U_over_D = U_over_D;
            let u = tau - p.linear.0[2];
            link.u_over_D = u * one_over_D;
            p = U_over_D.scale_add(u, I_a.apply(with_zeros(link.c)) + p);
            p.linear.0[2] = tau;
            (screw.inertia_to_parent(&I_a), screw.co_adjoint_apply_inverse(p))
        } else {
            let screw = screw_z(link.screw[0], link.screw[1], joint.screw.d);
            let (I_a, U_over_D, one_over_D) = I_A.eliminate_revolute();
            link.U_over_D.linear = U_over_D.linear;
            (link.U_over_D.angular.0[0], link.U_over_D.angular.0[1]) = (U_over_D.angular.0[0], U_over_D.angular.0[1]);
            let u = tau - p.angular.0[2];
            link.u_over_D = u * one_over_D;
            I_a.apply_across(link.c, &mut p);
            p = U_over_D.scale_add(u, p);
            p.angular.0[2] = tau;
            (screw.revolute_inertia_to_parent(&I_a), screw.co_adjoint_apply_inverse(p))
        };
        (self.inertia, self.p) = (joint.placement.inertia_to_parent(&I_a), joint.placement.wrench_to_parent(p_a));
    }

    /// Across a revolute joint with these parameters and a rotor of inertia `J`, free to move.
    #[inline(always)]
    pub fn across_geared<P: Param<L>, B: Param<L>, const SPARSE: bool>(
        &mut self,
        joint: &JointTerms<P, B>,
        parameters: &DhParameters<P>,
        J: L,
        tau: L,
        link: &mut LinkScratch<L>,
    ) {
        let own = &joint.body.inertia;
        if L::MANY_REGISTERS {
            let (x, z) = link.screws(parameters);
            let I_A = self.inertia.plus_own::<_, SPARSE>(own);
            let (I_a, p_a) = link.free(&I_A, link.p + self.p, J, tau);
            self.inertia = x.inertia_to_parent(&z.inertia_to_parent(&I_a));
            self.p = x.co_adjoint_apply_inverse(z.co_adjoint_apply_inverse(p_a));
            return;
        }
        self.column::<_, SPARSE>(own, J, tau, link);
        separate();
        self.linear::<_, _, SPARSE>(joint, parameters, link);
        separate();
        self.coupling::<_, _, SPARSE>(joint, parameters, link);
        separate();
        self.angular::<_, _, SPARSE>(joint, parameters, link);
        separate();
    }

    /// Column U of I_A, which stays in the inertia.
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
        let one_over_D = L::c(1.0) / (j[5] + J);
        link.J_over_D = J * one_over_D;
        link.u_over_D = (tau - (link.p.angular.0[2] + self.p.angular.0[2])) * one_over_D;
        link.U_over_D = Vector6::from_array([h[0][2], h[1][2], h[2][2], j[2], j[4], j[5]]).scale(one_over_D);
    }

    /// Linear block.
    #[inline(always)]
    fn linear<P: Param<L>, B: Param<L>, const SPARSE: bool>(
        &mut self,
        joint: &JointTerms<P, B>,
        parameters: &DhParameters<P>,
        link: &LinkScratch<L>,
    ) {
        let (mut m, h, s, own) = (self.inertia.m, &self.inertia.h, &link.U_over_D.linear.0, &joint.body.inertia);
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
        let (x, z) = link.screws(parameters);
        let m = z.linear_to_parent(&m, &mut self.of_screw);
        self.inertia.m = x.linear_to_parent(&m, &mut self.of_placement);
    }

    /// Coupling block, and linear part of `p_A + I_a c + U u / D`.
    #[inline(always)]
    fn coupling<P: Param<L>, B: Param<L>, const SPARSE: bool>(
        &mut self,
        joint: &JointTerms<P, B>,
        parameters: &DhParameters<P>,
        link: &LinkScratch<L>,
    ) {
        let Outer { inertia: SpatialInertia { m, h, j }, p, of_screw, of_placement, force, moment } = self;
        let ([x_rate, y_rate, x_turn, y_turn], own) = (&link.c, &joint.body.inertia);
        let mut rows = [[L::zero(); 3]; 3];
        // Each number is read where it is used: the compiler would move none past a number that is written.
        unroll!(i in 0 1 2 => {
            let s = link.U_over_D.linear.0[i];
            let of_p = h[i][2].mul_add(link.u_over_D, link.p.linear.0[i] + p.linear.0[i]);
            let mut row = h[i];
            if !SPARSE || i != 0 {
                row[0] += own.h[i][0].get();
            }
            if !SPARSE || i != 1 {
                row[1] += own.h[i][1].get();
            }
            row[0] = s.neg_mul_add(j[2], row[0]);
            row[1] = s.neg_mul_add(j[4], row[1]);
            row[2] = s.neg_mul_add(j[5], row[2]);
            p.linear.0[i] = (force[i] + row[1].mul_add(*y_turn, row[0] * *x_turn)) + of_p;
            rows[i] = row;
        });
        unroll!(k in 0 1 2 => {
            moment[k] = rows[1][k].mul_add(*y_rate, rows[0][k] * *x_rate);
        });
        let (x, z) = link.screws(parameters);
        let moved = z.coupling_to_parent(&rows, m, of_screw);
        *h = x.coupling_to_parent(&moved, m, of_placement);
    }

    /// Angular block, angular part of `p_A + I_a c + U u / D`, and that wrench in the parent's frame.
    #[inline(always)]
    fn angular<P: Param<L>, B: Param<L>, const SPARSE: bool>(
        &mut self,
        joint: &JointTerms<P, B>,
        parameters: &DhParameters<P>,
        link: &LinkScratch<L>,
    ) {
        let Outer { inertia: SpatialInertia { j, .. }, p, of_screw, of_placement, moment, .. } = self;
        let (s, own) = (&link.U_over_D.angular.0, &joint.body.inertia);
        let (mut i, t) = (*j, [j[2], j[4], j[5]]);
        i[0] += own.j[0].get();
        i[3] += own.j[3].get();
        if !SPARSE {
            i[1] += own.j[1].get();
        }
        i[0] = s[0].neg_mul_add(t[0], i[0]);
        i[1] = s[0].neg_mul_add(t[1], i[1]);
        i[2] = s[0].neg_mul_add(t[2], i[2]);
        i[3] = s[1].neg_mul_add(t[1], i[3]);
        i[4] = s[1].neg_mul_add(t[2], i[4]);
        i[5] = s[2].neg_mul_add(t[2], i[5]);
        let ([_, _, x_turn, y_turn], rows) = (link.c, [[i[0], i[1]], [i[1], i[3]], [i[2], i[4]]]);
        let mut p_a = *p;
        unroll!(k in 0 1 2 => {
            let of_p = t[k].mul_add(link.u_over_D, link.p.angular.0[k] + p.angular.0[k]);
            p_a.angular.0[k] = (rows[k][1].mul_add(y_turn, rows[k][0] * x_turn) + moment[k]) + of_p;
        });
        let (x, z) = link.screws(parameters);
        *j = x.angular_to_parent(&z.angular_to_parent(&i, of_screw), of_placement);
        *p = x.co_adjoint_apply_inverse(z.co_adjoint_apply_inverse(p_a));
    }
}

/// A joint that is not common, with branches that start at its link, and the branch that starts with it.
pub(super) struct Across<'a, L: Lane, P, B, const SPARSE: bool, const GEARED: bool> {
    pub outer: &'a mut Outer<L>,
    pub branches: &'a mut Branches<L>,
    pub joint: &'a JointTerms<P, B>,
    pub tau: L,
    pub at: (&'a ArmLoads<L>, usize, L),
    pub link: &'a mut LinkScratch<L>,
}

impl<L: Lane, P: Param<L>, B: Param<L>, const SPARSE: bool, const GEARED: bool> Routine<L>
    for Across<'_, L, P, B, SPARSE, GEARED>
{
    #[inline(always)]
    fn run(&mut self) {
        let Self { outer, branches, joint, tau, at, link } = self;
        if joint.branch.forks {
            cold_path();
            branches.take(at.1 + 1, &mut outer.inertia, &mut outer.p);
        }
        outer.across::<_, _, SPARSE, GEARED>(joint, *tau, *at, link);
        if let Some(carrier) = joint.branch.carrier {
            cold_path();
            branches.add(carrier, &mut outer.inertia, &mut outer.p);
        }
    }
}

//! Adjoint of the forward dynamics: cotangents of state, loads and parameters from the cotangents of the accelerations.
//!
//! Forward dynamics solve `M a = f` with a symmetric M. With the dual velocities lambda of `M lambda = cotangent of a`, one more
//! solution with the same M, the cotangent of anything that M and f depend on is minus the derivative of `lambda . (M a - f)`
//! with a and lambda fixed: one pass of inverse dynamics by Newton and Euler `[RF08 ch. 5]` and its reverse. Factorisation and
//! elimination are not differentiated.
//!
//! ```text
//! outward   V_i = Ad^-1 V_p + E q',   A_i = Ad^-1 A_p + c_i + E q'',   Lambda_i = Ad^-1 Lambda_p + E mu
//! bodies    F_i and the derivatives of Lambda_i . F_i by V_i, A_i and gravity
//! inward    their sums by Ad^-T;   d (Ad^-1 x) / dq = -ad_E Ad^-1 x   for x = V, A, Lambda
//! ```
//!
//! The linearly implicit form has `M + h D + h^2 K` in place of M, symmetric too, and D and K depend on the state.

#![allow(non_snake_case, reason = "inertias, twists and wrenches carry the symbols of the header")]

use std::hint::cold_path;

use super::aba::{ArmLoads, Instant, Scratch};
use super::aba_implicit::Ahead;
use super::body_adjoint::{AdjointMotion, BodyCotangents, add_factor_products, body_adjoint};
use super::branches::{at_carrier, motion_at_carrier};
use super::joint_torque::implicit_joint_torque;
use super::joint_torque_adjoint::joint_torque_adjoint;
use super::link::{add_joint_rate, joint_screws, with_zeros};
use crate::lane::{Lane, unroll};
use crate::lie::{Matrix3, Vector3, Vector6};
use crate::spatial::SpatialInertia;
use crate::system::{BodyTerms, Factors, JOINTS, JointTerms, System, UnscaledBodyTerms, WORLD};

/// Accelerations `[V'; q'']`, or their cotangents.
#[derive(Debug, Clone, Copy)]
pub struct Accelerations<'a, L> {
    /// V' relative to the water.
    pub twist: Vector6<L>,
    /// q''.
    pub qd: &'a [L; JOINTS],
}

/// Cotangents of an [`Instant`].
#[derive(Debug, Clone, Copy)]
pub struct InstantCotangents<L> {
    /// Cotangent of gravity.
    pub gravity: Vector3<L>,
    /// Cotangent of the vehicle's twist.
    pub twist: Vector6<L>,
    /// Cotangent of the joint coordinates.
    pub q: [L; JOINTS],
    /// Cotangent of the joint rates.
    pub qd: [L; JOINTS],
    /// Cotangent of the wrench on the vehicle.
    pub wrench: Vector6<L>,
    /// Cotangent of the linear rate of a fixed vehicle.
    pub fixed_rate: Vector3<L>,
}

impl<L: Lane> InstantCotangents<L> {
    /// Zeros, to be overwritten.
    #[inline(always)]
    pub fn blank() -> Self {
        let zero = [L::zero(); JOINTS];
        let (three, six) = (Vector3::zero(), Vector6::zero());
        Self { gravity: three, twist: six, q: zero, qd: zero, wrench: six, fixed_rate: three }
    }
}

/// Working memory: motion and sums of each link.
#[derive(Debug, Clone)]
pub struct AdjointScratch<L> {
    /// Working memory of the passes.
    pub scratch: Scratch<L>,
    acceleration: [Vector6<L>; JOINTS],
    pub(super) dual: [Vector6<L>; JOINTS],
    mu: [L; JOINTS],
    force: [Vector6<L>; JOINTS],
    of_twist: [Vector6<L>; JOINTS],
    of_acceleration: [Vector6<L>; JOINTS],
    of_gravity: [Vector3<L>; JOINTS],
    on_vehicle: BodyCotangents<L>,
}

impl<L: Lane> AdjointScratch<L> {
    /// Zeros. No pass reads an entry before it has written it.
    pub fn new() -> Self {
        let (zero, six) = (L::zero(), [Vector6::zero(); JOINTS]);
        Self {
            scratch: Scratch::new(),
            acceleration: six,
            dual: six,
            mu: [zero; JOINTS],
            force: six,
            of_twist: six,
            of_acceleration: six,
            of_gravity: [Vector3::zero(); JOINTS],
            on_vehicle: BodyCotangents::zero(),
        }
    }
}

impl<L: Lane> Default for AdjointScratch<L> {
    fn default() -> Self {
        Self::new()
    }
}

/// Inertia of a body; with `IMPLICIT`, `A + h D + h^2 K`.
#[inline(always)]
fn effective_inertia<L: Lane, const IMPLICIT: bool>(
    body: &BodyTerms<L>,
    h: L,
    twist: Vector6<L>,
    gravity: Vector3<L>,
) -> SpatialInertia<L> {
    let mut inertia = body.inertia;
    if IMPLICIT {
        for damping in &body.damping {
            inertia = damping.damping_matrix(twist).scale_add(h, &inertia);
        }
        if let Some(restoring) = &body.restoring {
            inertia.add_angular(h * h, &Matrix3::symmetric(&restoring.stiffness(gravity)));
        }
    }
    inertia
}

/// Component along the joint.
#[inline(always)]
pub(super) fn along<L: Lane>(joint: &JointTerms<L>, x: Vector6<L>) -> L {
    if joint.is_prismatic() { x.linear.0[2] } else { x.angular.0[2] }
}

/// Derivative of `of . Ad^-1 x` by the joint coordinate: `of . (-ad_E Ad^-1 x)`.
#[inline(always)]
pub(super) fn by_coordinate<L: Lane>(joint: &JointTerms<L>, of: Vector6<L>, x: Vector6<L>) -> L {
    let (f, w) = (of.linear.0, x.angular.0);
    if joint.is_prismatic() {
        return f[0].mul_add(w[1], -(f[1] * w[0]));
    }
    let (m, v) = (of.angular.0, x.linear.0);
    m[0].mul_add(w[1], f[0].mul_add(v[1], -(m[1].mul_add(w[0], f[1] * v[0]))))
}

/// Cotangents of instant, loads and factors from the cotangents of the accelerations at an instant. Sets `of_instant`, adds to
/// `of_loads` and, with the parts of the bodies, to the factors. The accelerations are results of [`super::aba::accelerations`],
/// with `IMPLICIT` of [`super::aba_implicit::implicit_accelerations`]; explicit methods do not use `step`.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "inputs, outputs and cotangents of one function")]
pub fn accelerations_adjoint<L: Lane, const IMPLICIT: bool>(
    system: &System<L>,
    at: &Instant<L>,
    step: Ahead<L>,
    loads: &ArmLoads<L>,
    accelerations: Accelerations<L>,
    cotangents: Accelerations<L>,
    memory: &mut AdjointScratch<L>,
    of_instant: &mut InstantCotangents<L>,
    of_loads: &mut ArmLoads<L>,
    mut factors: Option<(&[UnscaledBodyTerms<L>], &mut Factors<L>)>,
) {
    let Instant { gravity, twist, q, qd, time, .. } = *at;
    let (h, zero) = (step.h, L::zero());
    let joints = system.chain();
    let n = joints.len();
    let Scratch { links, branches, contact, water, .. } = &mut memory.scratch;
    let links = &mut links[..n];
    joint_screws(joints, true, q, links);
    let (mut g, mut V, mut A) = (gravity, twist, accelerations.twist);
    for i in 0..n {
        if let Some(carrier) = joints[i].branch.carrier {
            cold_path();
            (g, V) = motion_at_carrier(carrier, (water, at.elapsed), (gravity, twist), links);
            A = at_carrier(carrier, water.world_rate(), accelerations.twist, &memory.acceleration);
        }
        let (joint, link) = (&joints[i], &mut links[i]);
        A = link.twist_from_parent(joint, A);
        (g, V) = link.outward(joint, g, V, qd[i]);
        (link.g, link.V) = (g, V);
        A = add_joint_rate(joint, A + with_zeros(link.c), accelerations.qd[i]);
        memory.acceleration[i] = A;
    }

    if system.tree {
        cold_path();
        branches.clear(joints);
        memory.on_vehicle = BodyCotangents::zero();
    }
    // M lambda = cotangents: contributions of the outer links to I_A and to the bias.
    let (mut I_children, mut P_children) = (SpatialInertia::zero(), Vector6::zero());
    for i in (0..n).rev() {
        let (joint, link) = (&joints[i], &mut links[i]);
        if joint.branch.forks {
            cold_path();
            branches.take(i + 1, &mut I_children, &mut P_children);
        }
        let I_A = effective_inertia::<L, IMPLICIT>(&joint.body, h, link.V, link.g).plus(&I_children);
        let U = if joint.is_prismatic() { I_A.column::<2>() } else { I_A.column::<5>() };
        let mut D = along(joint, U);
        if let Some(J) = joint.rotor_inertia {
            D += J;
        }
        if IMPLICIT {
            D += implicit_joint_torque(joint, h, q[i], qd[i], loads.torque[i], loads.target(i, time)).1;
        }
        let over_D = if joint.prescribed { zero } else { L::c(1.0) / D };
        link.u_over_D = (cotangents.qd[i] - along(joint, P_children)) * over_D;
        link.U_over_D = U.scale(over_D);
        let P_a = U.scale_add(link.u_over_D, P_children);
        P_children = link.wrench_to_parent(joint, P_a);
        I_children = link.inertia_to_parent(joint, &I_A.eliminated(U, over_D));
        if let Some(carrier) = joint.branch.carrier {
            cold_path();
            branches.add(carrier, &mut I_children, &mut P_children);
        } else if i == 0 && system.tree {
            cold_path();
            branches.take(0, &mut I_children, &mut P_children);
        }
    }
    let mut dual = Vector6::zero();
    if !system.fixed {
        let mut I_A = effective_inertia::<L, IMPLICIT>(&system.vehicle, h, twist, gravity).plus(&I_children);
        if let (true, true, Some(gains)) = (IMPLICIT, step.vehicle_servo, &system.vehicle_servo) {
            unroll!(i in 0 1 2 3 4 5 => {
                I_A.add_diagonal(i, gains.kp[i].mul_add(h, gains.kd[i]) * h);
            });
        }
        dual = I_A.solve(cotangents.twist - P_children);
    }

    let base = AdjointMotion { twist, acceleration: accelerations.twist, gravity, dual };
    for i in 0..n {
        if let Some(carrier) = joints[i].branch.carrier {
            cold_path();
            dual = at_carrier(carrier, Vector6::zero(), base.dual, &memory.dual);
        }
        let (joint, link) = (&joints[i], &links[i]);
        let at_link = link.twist_from_parent(joint, dual);
        memory.mu[i] = link.u_over_D - link.U_over_D.dot(at_link);
        dual = add_joint_rate(joint, at_link, memory.mu[i]);
        memory.dual[i] = dual;
        let at = AdjointMotion { twist: link.V, acceleration: memory.acceleration[i], gravity: link.g, dual };
        let of = body_adjoint::<L, IMPLICIT>(&joint.body, h, &at);
        memory.force[i] = of.force;
        if loads.on_links {
            memory.force[i] = of.force - loads.links[i];
            of_loads.links[i] = of_loads.links[i] + dual;
        }
        if system.contact.is_some() {
            cold_path();
            memory.force[i] = memory.force[i] - contact.links[i];
        }
        memory.of_twist[i] = of.of_twist;
        memory.of_acceleration[i] = of.of_acceleration;
        memory.of_gravity[i] = of.of_gravity;
        if let Some((parts, of)) = &mut factors
            && let Some(parts) = parts.get(i + 1)
        {
            add_factor_products::<L, IMPLICIT>(&joint.body, parts, h, &at, of);
        }
    }

    let mut sums = BodyCotangents::zero();
    for i in (0..n).rev() {
        let (joint, link) = (&joints[i], &links[i]);
        let force = memory.force[i] + sums.force;
        let mut of_V = memory.of_twist[i] + sums.of_twist;
        let of_A = memory.of_acceleration[i] + sums.of_acceleration;
        let of_g = memory.of_gravity[i] + sums.of_gravity;
        // c = -ad_E V q' of A.
        let mut of_qd = by_coordinate(joint, of_A, link.V);
        let (f, m) = (of_A.linear.0, of_A.angular.0);
        if joint.is_prismatic() {
            of_V.angular.0[0] = f[1].neg_mul_add(qd[i], of_V.angular.0[0]);
            of_V.angular.0[1] = f[0].mul_add(qd[i], of_V.angular.0[1]);
        } else {
            of_V.linear.0[0] = f[1].neg_mul_add(qd[i], of_V.linear.0[0]);
            of_V.linear.0[1] = f[0].mul_add(qd[i], of_V.linear.0[1]);
            of_V.angular.0[0] = m[1].neg_mul_add(qd[i], of_V.angular.0[0]);
            of_V.angular.0[1] = m[0].mul_add(qd[i], of_V.angular.0[1]);
        }
        of_qd += along(joint, of_V);
        let mut of_q = by_coordinate(joint, of_V, link.V) + by_coordinate(joint, force, memory.dual[i]);
        of_q += by_coordinate(joint, of_A, memory.acceleration[i] - with_zeros(link.c));
        if !joint.is_prismatic() {
            of_q += of_g.0[0].mul_add(link.g.0[1], -(of_g.0[1] * link.g.0[0]));
        }
        (of_instant.q[i], of_instant.qd[i]) = (-of_q, -of_qd);
        let (mu, qdd) = (memory.mu[i], accelerations.qd[i]);
        if joint.prescribed {
            let of = cotangents.qd[i] - along(joint, of_A);
            if IMPLICIT {
                if loads.terms > 0 {
                    let of = of / h;
                    add_target(loads.terms, time, [zero, of], &mut of_loads.target[i]);
                    of_instant.qd[i] -= of;
                }
            } else if loads.terms > 2 {
                let target = &mut of_loads.target[i];
                target[2] = of.mul_add(L::c(2.0), target[2]);
                target[3] = (of * time).mul_add(L::c(6.0), target[3]);
            }
        } else {
            let numbers = [q[i], qd[i], loads.torque[i]];
            let of = joint_torque_adjoint::<L, IMPLICIT>(joint, h, numbers, loads.target(i, time), [mu, -(mu * qdd)]);
            of_instant.q[i] += of.q;
            of_instant.qd[i] += of.qd;
            of_loads.torque[i] += of.command;
            add_target(loads.terms, time, of.target, &mut of_loads.target[i]);
        }
        sums.force = link.wrench_to_parent(joint, force);
        sums.of_twist = link.wrench_to_parent(joint, of_V);
        sums.of_acceleration = link.wrench_to_parent(joint, of_A);
        sums.of_gravity = link.wrench_to_parent(joint, Vector6 { linear: of_g, angular: Vector3::zero() }).linear;
        if let Some(carrier) = joint.branch.carrier {
            cold_path();
            if carrier == WORLD {
                // The world's motion is given.
            } else if let Some(k) = (carrier as usize).checked_sub(1)
                && k < n
            {
                memory.force[k] = memory.force[k] + sums.force;
                memory.of_twist[k] = memory.of_twist[k] + sums.of_twist;
                memory.of_acceleration[k] = memory.of_acceleration[k] + sums.of_acceleration;
                memory.of_gravity[k] = memory.of_gravity[k] + sums.of_gravity;
            } else {
                memory.on_vehicle = memory.on_vehicle.plus(&sums);
            }
            sums = BodyCotangents::zero();
        } else if i == 0 && system.tree {
            cold_path();
            sums = sums.plus(&memory.on_vehicle);
        }
    }

    if system.fixed {
        of_instant.twist = -sums.of_twist;
        of_instant.gravity = -sums.of_gravity;
        of_instant.wrench = Vector6::zero();
        of_instant.fixed_rate = cotangents.twist.linear - sums.of_acceleration.linear;
        return;
    }
    let of = body_adjoint::<L, IMPLICIT>(&system.vehicle, h, &base);
    let mut of_twist = (sums.of_twist + of.of_twist).to_array();
    if let (true, true, Some(gains)) = (IMPLICIT, step.vehicle_servo, &system.vehicle_servo) {
        let dual = base.dual.to_array();
        unroll!(i in 0 1 2 3 4 5 => {
            of_twist[i] = (gains.kp[i] * h).mul_add(dual[i], of_twist[i]);
        });
    }
    if let Some((parts, factors)) = &mut factors
        && let Some(parts) = parts.first()
    {
        add_factor_products::<L, IMPLICIT>(&system.vehicle, parts, h, &base, factors);
    }
    of_instant.twist = -Vector6::from_array(of_twist);
    of_instant.gravity = -(sums.of_gravity + of.of_gravity);
    of_instant.wrench = base.dual;
    of_instant.fixed_rate = Vector3::zero();
}

/// Adds the cotangents of a target's coefficients from the cotangents of its value and its rate at a time.
#[inline(always)]
pub fn add_target<L: Lane>(terms: usize, time: L, [value, rate]: [L; 2], of: &mut [L; 4]) {
    if terms > 0 {
        of[0] += value;
        of[1] += value.mul_add(time, rate);
    }
    if terms > 2 {
        let twice = rate + rate;
        of[2] = value.mul_add(time, twice).mul_add(time, of[2]);
        of[3] = value.mul_add(time, twice + rate).mul_add(time * time, of[3]);
    }
}

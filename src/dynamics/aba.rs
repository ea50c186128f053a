//! Articulated-body algorithm: forward dynamics in O(n), evaluated at every stage of every step. `[RF08 ch. 7]`, `[McM95]`
//!
//! It solves the equations of motion of the closed form in the frame that moves with the water. There rigid and added
//! inertia obey one law with the twist V relative to the water; a uniform steady current changes nothing but the
//! observer. If the current accelerates by a_c, that frame accelerates with it, so `g - a_c` replaces g in weight and in
//! buoyancy.
//!
//! ```text
//! outward   V_i = Ad^-1 V_p + E q',   p_i = B V_i - F_i,   c_i = ad_V_i E q'
//! inward    U = I_A E,   D = E^T U + J,   I_a = I_A - U U^T / D,   I_A,p += Ad^-T I_a Ad^-1
//!           u = tau - E^T p_A,   p_a = p_A + I_a c + U u / D,   p_A,p += Ad^-T p_a
//! base      I_A,0 V_0' = -p_A,0
//! outward   q'' = (u - U^T (Ad^-1 V_p' + c)) / D,   V_i' = Ad^-1 V_p' + c + E q''
//! ```
//!
//! A prescribed joint is the limit of an infinite J with `u / D = q''`: nothing is eliminated, I_a = I_A and
//! `p_a = p_A + I_A (c + E q'')` (hybrid dynamics, `[RF08 sec. 9.2]`).
//!
//! J is the inertia of the joint's rotor, reflected by its gear. Without a rotor, I_a c has no component along the joint, so u does
//! not depend on when it is added. Inertias and wrenches go inward in the same loop: the results of one joint are still in
//! registers for the next, and both dependency chains overlap.

#![allow(non_snake_case, reason = "inertias, twists and wrenches carry the symbols of the header")]

use std::hint::cold_path;

use super::articulation::{Across, Outer};
use super::branches::{Branches, at_carrier, fill, motion_at_carrier, rate_at_carrier, stored_zero};
use super::common_joint::{dh_parameters, if_common};
use super::joint_torque::joint_torque;
pub use super::link::Scratch;
use super::link::{LinkScratch, add_joint_rate, joint_screws};
use super::place::WaterFrame;
use crate::lane::{Lane, Param, Routine};
use crate::lie::{Vector3, Vector6};
use crate::spatial::{LinkTwist, SpatialInertia};
use crate::system::{BodyTerms, JOINTS, JointKind, JointTerms, System};

/// Joint torques, servo targets and external link wrenches, constant over a control period except for the targets.
#[derive(Debug, Clone, Copy)]
pub struct ArmLoads<L> {
    /// Actuator torques, N m or N.
    pub torque: [L; JOINTS],
    /// Number of coefficients of the servo targets; 0 where the joint servos are off.
    pub terms: usize,
    /// Servo targets, rad or m: cubic polynomials in time, constant term first. The first two coefficients are always read.
    pub target: [[L; 4]; JOINTS],
    /// True if `links` holds wrenches.
    pub on_links: bool,
    /// External wrenches on the links, each in its joint's frame, N and N m.
    pub links: [Vector6<L>; JOINTS],
}

impl<L: Lane> ArmLoads<L> {
    /// No loads.
    #[inline(always)]
    pub fn none() -> Self {
        Self {
            torque: [L::zero(); JOINTS],
            terms: 0,
            target: [[L::zero(); 4]; JOINTS],
            on_links: false,
            links: [Vector6::zero(); JOINTS],
        }
    }

    /// Sets the loads on the joints in use to 0.
    #[inline(always)]
    pub fn clear(&mut self, joints: usize) {
        for i in 0..joints.min(JOINTS) {
            (self.torque[i], self.target[i], self.links[i]) = (L::zero(), [L::zero(); 4], Vector6::zero());
        }
    }

    /// Target of joint `i` and its rate at `time`.
    #[inline(always)]
    pub fn target(&self, i: usize, time: L) -> Option<(L, L)> {
        if self.terms == 0 {
            return None;
        }
        let [a, b, c, d] = self.target[i];
        if self.terms <= 2 {
            return Some((b.mul_add(time, a), b));
        }
        // Horner's rule; the rate reuses the partial sums of the value.
        let two = d.mul_add(time, c);
        let one = two.mul_add(time, b);
        Some((one.mul_add(time, a), d.mul_add(time, two).mul_add(time, one)))
    }

    /// Second derivative of the target of joint `i` at `time`; 0 without target.
    #[inline(always)]
    pub fn target_acceleration(&self, i: usize, time: L) -> L {
        if self.terms <= 2 {
            return L::zero();
        }
        let [_, _, c, d] = self.target[i];
        (d * L::c(3.0)).mul_add(time, c) * L::c(2.0)
    }
}

/// State and vehicle wrench of one instance per lane at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Instant<'a, L> {
    /// True at the start of a step; later instants up to the next start belong to the same step.
    pub is_start: bool,
    /// Gravity less the acceleration of the water, vehicle axes, m/s2.
    pub gravity: Vector3<L>,
    /// Vehicle twist relative to the water, m/s and rad/s.
    pub twist: Vector6<L>,
    /// Joint coordinates.
    pub q: &'a [L; JOINTS],
    /// Joint rates.
    pub qd: &'a [L; JOINTS],
    /// Wrench on the vehicle, body axes at its origin, N and N m.
    pub wrench: &'a Vector6<L>,
    /// Linear rate of `twist` of a fixed vehicle: minus the acceleration of the water.
    pub fixed_rate: Option<Vector3<L>>,
    /// Time of the servo targets, s.
    pub time: L,
    /// Time since the start of the step, s: the velocity of the water is known at that start ([`Scratch::water`]).
    pub elapsed: L,
}

/// Bias wrench `B V - restoring - damping` of one body, written to `bias`: a value that merges after a branch would go
/// through memory in addition.
#[inline(always)]
pub(super) fn body_bias<L: Lane, B: Param<L>, const SPARSE: bool>(
    body: &BodyTerms<B>,
    twist: Vector6<L>,
    gravity: Vector3<L>,
    bias: &mut Vector6<L>,
) {
    let mut damping = &body.damping[..];
    if let Some(central) = &body.central {
        central.bias(twist, gravity, bias);
        // Bodies shared by all instances carry no payload of single instances.
        if let (Some(payload), false) = (&body.payload, B::SHARED) {
            payload.add_bias(twist, gravity, bias);
        }
        damping = damping.get(1..).unwrap_or_default();
    } else {
        *bias =
            if SPARSE { body.inertia.get().sparse_bias_wrench(twist) } else { body.inertia.get().bias_wrench(twist) };
        if let Some(restoring) = &body.restoring {
            *bias = restoring.subtract(gravity, *bias);
        }
    }
    for damping in damping {
        *bias = *bias - damping.wrench(twist);
    }
}

/// Forward dynamics: `V'` with V relative to the water, and `q''`. Entries of `qdd` past the joint count are untouched. With `ONCE`
/// speed does not matter: [`Lane::ONE_FORM`].
#[inline(always)]
pub fn accelerations<L: Lane, P: Param<L>, B: Param<L>, const ONCE: bool>(
    system: &System<P, B>,
    at: &Instant<L>,
    loads: &ArmLoads<L>,
    scratch: &mut Scratch<L>,
    twist_rate: &mut Vector6<L>,
    qdd: &mut [L; JOINTS],
) {
    let Instant { is_start, gravity, twist, q, .. } = *at;
    let joints = system.chain();
    if joints.is_empty() {
        let none = (SpatialInertia::zero(), Vector6::zero());
        *twist_rate = if system.sparse && const { !ONCE && !L::ONE_FORM } {
            vehicle_rate::<_, _, _, true>(system, at, &none.0, none.1)
        } else {
            vehicle_rate::<_, _, _, false>(system, at, &none.0, none.1)
        };
        return;
    }
    let Scratch { links, branches, contact, water, outer, .. } = scratch;
    let links = &mut links[..joints.len()];

    if system.tree {
        cold_path();
        branches.clear(joints);
    }
    joint_screws(joints, is_start, q, links);
    let (mut g, mut V) = (gravity, twist);
    // Two loops: the common kind of links needs no branch, and so no pass through memory.
    if system.z_aligned {
        for i in 0..joints.len() {
            (g, V) = outward::<_, _, _, ONCE>(joints, i, (water, at), (g, V), links);
            let (joint, link) = (&joints[i], &mut links[i]);
            let Some(central) = &joint.body.central else {
                cold_path();
                continue;
            };
            central.bias_z_aligned(V, g, &mut link.p);
            if let (false, true, Some(payload)) = (B::SHARED, joint.branch.forks, &joint.body.payload) {
                cold_path();
                payload.add_bias(V, g, &mut link.p);
            }
        }
        // A payload is on the last link, or on one that `forks`.
        if let (Some(joint), Some(link)) = (joints.last(), links.last_mut())
            && let (Some(payload), false) = (&joint.body.payload, B::SHARED)
        {
            payload.add_bias(V, g, &mut link.p);
        }
    } else {
        for i in 0..joints.len() {
            (g, V) = outward::<_, _, _, ONCE>(joints, i, (water, at), (g, V), links);
            body_bias::<_, _, false>(&joints[i].body, V, g, &mut links[i].p);
        }
    }
    if loads.on_links {
        for i in 0..joints.len() {
            links[i].p = links[i].p - loads.links[i];
        }
    }
    if system.contact.is_some() {
        cold_path();
        for i in 0..joints.len() {
            links[i].p = links[i].p - contact.links[i];
        }
    }

    // The form for dense inertias and geared joints serves all systems.
    if const { ONCE || L::ONE_FORM } {
        inward::<_, _, _, false, true, ONCE>(system, at, loads, links, branches, outer, twist_rate);
    } else {
        match (system.sparse, system.geared) {
            (true, true) => inward::<_, _, _, true, true, ONCE>(system, at, loads, links, branches, outer, twist_rate),
            (true, false) => {
                inward::<_, _, _, true, false, ONCE>(system, at, loads, links, branches, outer, twist_rate)
            }
            (false, true) => {
                inward::<_, _, _, false, true, ONCE>(system, at, loads, links, branches, outer, twist_rate)
            }
            (false, false) => {
                inward::<_, _, _, false, false, ONCE>(system, at, loads, links, branches, outer, twist_rate)
            }
        }
    }

    let mut V_dot = *twist_rate;
    for i in 0..joints.len() {
        let (joint, link) = (&joints[i], &links[i]);
        if_common!(const { ONCE || L::ONE_FORM }, joint, |parameters| {
            let (x, z) = link.screws::<P>(&parameters);
            (V_dot, qdd[i]) = link.accelerate(z.adjoint_apply_inverse(x.adjoint_apply_inverse(V_dot)), false, true);
            continue;
        });
        if let Some(carrier) = joint.branch.carrier {
            cold_path();
            V_dot = rate_at_carrier(carrier, water, *twist_rate, links);
        }
        let parent = links[i].twist_from_parent(joint, V_dot);
        (V_dot, qdd[i]) = links[i].accelerate(parent, joint.is_prismatic(), joint.rotor_inertia.is_some());
        if joint.branch.forks {
            cold_path();
            links[i].V = V_dot;
        }
    }
}

/// Gravity and twist of link `i` from those of the link before it.
#[inline(always)]
fn outward<L: Lane, P: Param<L>, B, const ONCE: bool>(
    joints: &[JointTerms<P, B>],
    i: usize,
    (water, at): (&WaterFrame<L>, &Instant<L>),
    (mut g, mut V): (Vector3<L>, Vector6<L>),
    links: &mut [LinkScratch<L>],
) -> (Vector3<L>, Vector6<L>) {
    let (joint, link, qd) = (&joints[i], &mut links[i], at.qd[i]);
    if_common!(const { ONCE || L::ONE_FORM }, joint, |parameters| return link.outward_common::<P>(
        &parameters,
        g,
        V,
        qd
    ));
    if let Some(carrier) = joint.branch.carrier {
        cold_path();
        (g, V) = motion_at_carrier(carrier, (water, at.elapsed), (at.gravity, at.twist), links);
    }
    let link = &mut links[i];
    (g, V) = link.outward(joint, g, V, qd);
    if joint.branch.forks {
        cold_path();
        (link.g, link.V) = (g, V);
    }
    (g, V)
}

/// Inward pass and base: `V'` of the vehicle, and U, u and D of each joint for the outward pass.
#[inline(always)]
fn inward<L: Lane, P: Param<L>, B: Param<L>, const SPARSE: bool, const GEARED: bool, const ONCE: bool>(
    system: &System<P, B>,
    at: &Instant<L>,
    loads: &ArmLoads<L>,
    links: &mut [LinkScratch<L>],
    branches: &mut Branches<L>,
    outer: &mut Outer<L>,
    twist_rate: &mut Vector6<L>,
) {
    let Instant { q, qd, time, .. } = *at;
    let in_memory = GEARED && !L::MANY_REGISTERS;
    let mut registers;
    let outer = if in_memory {
        fill(stored_zero(), &mut outer.inertia, &mut outer.p);
        outer
    } else {
        registers = Outer::zero();
        &mut registers
    };
    let servos_on = loads.terms > 0;
    // From the last joint inwards, without an index that would be checked.
    let (mut joints, mut links) = (system.chain(), links);
    while let ([inner @ .., joint], [inner_links @ .., link]) = (joints, links) {
        let i = inner.len();
        (joints, links) = (inner, inner_links);
        let target = if servos_on { loads.target(i, time) } else { None };
        let tau = joint_torque(joint, q[i], qd[i], loads.torque[i], target);
        if let (true, Some(J)) = (GEARED, &joint.rotor_inertia) {
            if_common!(const { ONCE || L::ONE_FORM }, joint, |parameters| {
                outer.across_geared::<_, _, SPARSE>(joint, &parameters, J.get(), tau, link);
                continue;
            });
        }
        let (outer, branches, at) = (&mut *outer, &mut *branches, (loads, i, time));
        if in_memory {
            cold_path();
            L::call(&mut Across::<_, _, _, false, true> { outer, branches, joint, tau, at, link });
        } else {
            Across::<_, _, _, SPARSE, GEARED> { outer, branches, joint, tau, at, link }.run();
        }
    }
    if system.tree {
        cold_path();
        branches.take(0, &mut outer.inertia, &mut outer.p);
    }

    *twist_rate = vehicle_rate::<_, _, _, SPARSE>(system, at, &outer.inertia, outer.p);
}

/// `V'` of the vehicle under the inertia and the bias wrench of what it carries.
#[inline(always)]
fn vehicle_rate<L: Lane, P: Param<L>, B: Param<L>, const SPARSE: bool>(
    system: &System<P, B>,
    at: &Instant<L>,
    I_children: &SpatialInertia<L>,
    p_children: Vector6<L>,
) -> Vector6<L> {
    if let Some(linear) = at.fixed_rate {
        return Vector6 { linear, angular: Vector3::zero() };
    }
    let mut p = Vector6::zero();
    body_bias::<_, _, SPARSE>(&system.vehicle, at.twist, at.gravity, &mut p);
    I_children.plus_own::<_, SPARSE>(&system.vehicle.inertia).solve(*at.wrench - (p + p_children))
}

/// Twist of each link in its joint's frame, m/s and rad/s, relative to the same medium as the twists of vehicle and world.
#[inline(always)]
pub fn link_twists<L: Lane, P: Param<L>, B>(
    system: &System<P, B>,
    [twist, world]: [Vector6<L>; 2],
    q: &[L; JOINTS],
    qd: &[L; JOINTS],
    scratch: &mut Scratch<L>,
    twists: &mut [Vector6<L>],
) {
    let joints = system.chain();
    let links = &mut scratch.links[..joints.len()];
    joint_screws(joints, true, q, links);
    let mut parent = twist;
    for i in 0..joints.len().min(twists.len()) {
        if let Some(carrier) = joints[i].branch.carrier {
            cold_path();
            parent = at_carrier(carrier, world, twist, twists);
        }
        parent = add_joint_rate(&joints[i], links[i].twist_from_parent(&joints[i], parent), qd[i]);
        twists[i] = parent;
    }
}

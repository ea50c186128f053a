//! The articulated-body form: accelerations in O(n), the form that steps. `[RF08 ch. 7]`, `[McM95]`
//!
//! It solves the same balance as the closed form. Written in the frame that moves with the water: there rigid and
//! added inertia obey one law, with the twist V relative to the water (a uniform steady current changes nothing but
//! the reader's point of view). If the current accelerates by a_c, that frame accelerates with it: `g - a_c` takes the
//! place of g, in weight as in buoyancy.
//!
//! ```text
//! outward   V_i = Ad^-1 V_p + E q',   c_i = ad_V_i E q'
//! inward    p_i = B V_i - F_i,  u = tau - E^T p,  U = A E,  D = E^T U
//!           A_p += Ad^-T (A - U U^T / D) Ad^-1,   p_p += Ad^-T (p + (A - U U^T / D) c + U u / D)
//! base      A_0 V_0' = -p_0
//! outward   q'' = (u - U^T (Ad^-1 V_p' + c)) / D,   V_i' = Ad^-1 V_p' + c + E q''
//! ```

use super::joint_torque::joint_torque;
use crate::lane::{Lane, Param, get_all, sin_cos};
use crate::lie::{Pose, Vector3, Vector6};
use crate::spatial::{Screw, SpatialInertia, constant_screw_z, screw_x, screw_z};
use crate::system::{BodyTerms, JOINTS, JointTerms, Stand, System};

/// Forces at the joints and on the links besides those of the system itself; held over a control period.
#[derive(Debug, Clone, Copy)]
pub struct Loads<L> {
    /// Actuator torques.
    pub torque: [L; JOINTS],
    /// Whether the joint servos are on.
    pub servo: bool,
    /// Servo targets, as polynomials in the time, constant term first.
    pub target: [[L; 4]; JOINTS],
    /// Whether `links` holds anything.
    pub on_links: bool,
    /// External wrenches on the links, each in its joint's frame.
    pub links: [Vector6<L>; JOINTS],
}

impl<L: Lane> Loads<L> {
    /// None.
    #[inline(always)]
    pub fn none() -> Self {
        Self {
            torque: [L::zero(); JOINTS],
            servo: false,
            target: [[L::zero(); 4]; JOINTS],
            on_links: false,
            links: [Vector6::zero(); JOINTS],
        }
    }

    /// Servo target of joint `i`: value and rate at `time`.
    #[inline(always)]
    pub(super) fn target(&self, i: usize, time: L) -> Option<(L, L)> {
        if !self.servo {
            return None;
        }
        let [a, b, c, d] = self.target[i];
        let value = d.mul_add(time, c).mul_add(time, b).mul_add(time, a);
        let rate = (L::c(3.0) * d).mul_add(time, L::c(2.0) * c).mul_add(time, b);
        Some((value, rate))
    }
}

/// What the outward pass leaves for the inward one, and that for the last.
#[derive(Debug, Clone, Copy)]
pub(super) struct LinkScratch<L> {
    /// Sine and cosine of theta, and d.
    pub screw: [L; 3],
    pub twist: Vector6<L>,
    pub gravity: Vector3<L>,
    /// U, 1/D and u.
    pub column: Vector6<L>,
    pub over_d: L,
    pub torque: L,
}

/// Working memory of [`accelerations`].
#[derive(Debug, Clone)]
pub struct Scratch<L>(pub(super) [LinkScratch<L>; JOINTS]);

impl<L: Lane> Scratch<L> {
    /// Fresh memory; its contents never matter.
    pub fn new() -> Self {
        let zero = L::zero();
        let link = LinkScratch {
            screw: [zero; 3],
            twist: Vector6::zero(),
            gravity: Vector3::zero(),
            column: Vector6::zero(),
            over_d: zero,
            torque: zero,
        };
        Self([link; JOINTS])
    }
}

impl<L: Lane> Default for Scratch<L> {
    fn default() -> Self {
        Self::new()
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
    fn rotate_back(&self, v: Vector3<L>) -> Vector3<L> {
        match self {
            Base::Bend(x) => x.rotate_back(v),
            Base::Crank(z, x) => x.rotate_back(z.rotate_back(v)),
            Base::Pose(pose) => pose.rotation.apply_transposed(v),
        }
    }

    #[inline(always)]
    pub fn carry(&self, inertia: &SpatialInertia<L>, wrench: Vector6<L>) -> (SpatialInertia<L>, Vector6<L>) {
        match self {
            Base::Bend(x) => (x.inertia_to_parent(inertia), x.co_adjoint_apply_inverse(wrench)),
            Base::Crank(z, x) => (
                z.inertia_to_parent(&x.inertia_to_parent(inertia)),
                z.co_adjoint_apply_inverse(x.co_adjoint_apply_inverse(wrench)),
            ),
            Base::Pose(pose) => (inertia.to_parent(pose), pose.co_adjoint_apply_inverse(wrench)),
        }
    }
}

/// `ad_V E q'`: `[v x e_z; omega x e_z] q'` for a turning joint, `[omega x e_z; 0] q'` for a sliding one.
#[inline(always)]
pub(super) fn velocity_product<L: Lane>(prismatic: bool, twist: Vector6<L>, qd: L) -> Vector6<L> {
    let (v, w) = (twist.linear.0, twist.angular.0);
    let across = Vector3([w[1] * qd, -(w[0] * qd), L::zero()]);
    if prismatic {
        Vector6 { linear: across, angular: Vector3::zero() }
    } else {
        Vector6 { linear: Vector3([v[1] * qd, -(v[0] * qd), L::zero()]), angular: across }
    }
}

/// `B V - restoring - drag`: what a body's own motion and the water ask for.
#[inline(always)]
pub(super) fn body_bias<L: Lane, P: Param<L>>(
    body: &BodyTerms<P>,
    inertia: &SpatialInertia<L>,
    twist: Vector6<L>,
    gravity: Vector3<L>,
) -> Vector6<L> {
    let mut bias = inertia.bias_wrench(twist);
    let minus = L::c(-1.0);
    if let Some(restoring) = &body.restoring {
        bias = restoring.wrench(gravity).scale_add(minus, bias);
    }
    for drag in &body.drag {
        bias = drag.wrench(twist).scale_add(minus, bias);
    }
    bias
}

/// One instance (per lane) at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Instant<'a, L> {
    /// Gravity in vehicle axes.
    pub gravity: Vector3<L>,
    /// Vehicle twist relative to the water.
    pub twist: Vector6<L>,
    /// Joint coordinates.
    pub q: &'a [L; JOINTS],
    /// Joint rates.
    pub qd: &'a [L; JOINTS],
    /// Wrench on the vehicle, body frame at its origin.
    pub wrench: Vector6<L>,
    /// Linear rate of `twist` of a held vehicle: what water that accelerates runs away from it. Counts for no other.
    pub held_rate: Vector3<L>,
    /// Time on the clock of the servo targets.
    pub time: L,
}

/// Twists and gravity from the vehicle outward.
#[inline(always)]
pub(super) fn outward<L: Lane, P: Param<L>>(
    joints: &[JointTerms<P>],
    twist: Vector6<L>,
    gravity: Vector3<L>,
    q: &[L; JOINTS],
    qd: &[L; JOINTS],
    links: &mut [LinkScratch<L>],
) {
    let (mut parent_twist, mut parent_gravity) = (twist, gravity);
    for (i, (joint, link)) in joints.iter().zip(links.iter_mut()).enumerate() {
        let coordinate = joint.offset.get() + q[i];
        let [k0, k1] = get_all(&joint.constant);
        let (sin, cos, d) = if joint.prismatic {
            (k0, k1, coordinate)
        } else {
            let (sin, cos) = sin_cos(coordinate);
            (sin, cos, k0)
        };
        link.screw = [sin, cos, d];
        let screw = screw_z(sin, cos, d);
        let base = Base::of(&joint.stand);
        let mut twist = screw.adjoint_apply_inverse(base.twist(parent_twist));
        let moved = if joint.prismatic { &mut twist.linear.0[2] } else { &mut twist.angular.0[2] };
        *moved += qd[i];
        link.twist = twist;
        link.gravity = screw.rotate_back(base.rotate_back(parent_gravity));
        (parent_twist, parent_gravity) = (twist, link.gravity);
    }
}

/// Twist of each link in its joint's frame, relative to what `twist` of the vehicle is relative to.
#[inline(always)]
pub fn link_twists<L: Lane, P: Param<L>>(
    system: &System<P>,
    twist: Vector6<L>,
    q: &[L; JOINTS],
    qd: &[L; JOINTS],
    scratch: &mut Scratch<L>,
    twists: &mut [Vector6<L>],
) {
    let joints = system.joints.as_slice();
    let links = &mut scratch.0[..joints.len()];
    outward(joints, twist, Vector3::zero(), q, qd, links);
    for (twist, link) in twists.iter_mut().zip(links.iter()) {
        *twist = link.twist;
    }
}

/// The last pass: `q''` from `V'`.
#[inline(always)]
pub(super) fn outward_rates<L: Lane, P: Param<L>>(
    joints: &[JointTerms<P>],
    links: &[LinkScratch<L>],
    qd: &[L; JOINTS],
    twist_rate: Vector6<L>,
    qdd: &mut [L; JOINTS],
) {
    let mut parent = twist_rate;
    for (i, (joint, link)) in joints.iter().zip(links.iter()).enumerate() {
        let [sin, cos, d] = link.screw;
        let carried = screw_z(sin, cos, d).adjoint_apply_inverse(Base::of(&joint.stand).twist(parent));
        let mut rate = carried + velocity_product(joint.prismatic, link.twist, qd[i]);
        let acceleration = (link.torque - link.column.dot(rate)) * link.over_d;
        let moved = if joint.prismatic { &mut rate.linear.0[2] } else { &mut rate.angular.0[2] };
        *moved += acceleration;
        qdd[i] = acceleration;
        parent = rate;
    }
}

/// Works out `V'`, V relative to the water, and `q''`; entries of `qdd` past the joint count are untouched.
#[inline(always)]
pub fn accelerations<L: Lane, P: Param<L>>(
    system: &System<P>,
    at: &Instant<L>,
    loads: &Loads<L>,
    scratch: &mut Scratch<L>,
    twist_rate: &mut Vector6<L>,
    qdd: &mut [L; JOINTS],
) {
    let Instant { gravity, twist, q, qd, wrench, held_rate, time } = *at;
    let joints = system.joints.as_slice();
    let links = &mut scratch.0[..joints.len()];

    outward(joints, twist, gravity, q, qd, links);

    // What the links already done ask of the body at hand.
    let mut carried = (SpatialInertia::zero(), Vector6::zero());
    for (i, (joint, link)) in joints.iter().zip(links.iter_mut()).enumerate().rev() {
        let own: SpatialInertia<L> = joint.body.inertia.get();
        let mut bias = body_bias(&joint.body, &own, link.twist, link.gravity);
        if loads.on_links {
            bias = loads.links[i].scale_add(L::c(-1.0), bias);
        }
        let inertia = own.plus(&carried.0);
        bias = bias + carried.1;
        let (column, d, along) = joint_column(joint, &inertia, bias);
        let torque = joint_torque(joint, q[i], qd[i], loads.torque[i], loads.target(i, time)) - along;
        let over_d = L::c(1.0) / d;
        (link.column, link.over_d, link.torque) = (column, over_d, torque);

        let c = velocity_product(joint.prismatic, link.twist, qd[i]);
        let bias = column.scale_add(torque * over_d, bias);
        let [sin, cos, d] = link.screw;
        let screw = screw_z(sin, cos, d);
        let (rest, wrench) = if joint.prismatic {
            let rest = inertia.eliminated(column, over_d);
            (screw.inertia_to_parent(&rest), rest.apply(c) + bias)
        } else {
            let rest = inertia.turn_eliminated(column, over_d);
            (screw.turning_inertia_to_parent(&rest), rest.apply_across(c, bias))
        };
        carried = Base::of(&joint.stand).carry(&rest, screw.co_adjoint_apply_inverse(wrench));
    }

    if system.fixed {
        *twist_rate = Vector6 { linear: held_rate, angular: Vector3::zero() };
    } else {
        let own: SpatialInertia<L> = system.vehicle.inertia.get();
        let bias = body_bias(&system.vehicle, &own, twist, gravity) + carried.1;
        *twist_rate = own.plus(&carried.0).solve(bias.scale_add(L::c(-1.0), wrench));
    }

    outward_rates(joints, links, qd, *twist_rate, qdd);
}

/// `U = A E`, `D = E^T A E` and `E^T p`.
#[inline(always)]
pub(super) fn joint_column<L: Lane, P>(
    joint: &JointTerms<P>,
    inertia: &SpatialInertia<L>,
    bias: Vector6<L>,
) -> (Vector6<L>, L, L) {
    let (m, h, j) = (&inertia.m, &inertia.h, &inertia.j);
    if joint.prismatic {
        let column = Vector6::from_array([m[2], m[4], m[5], h[2][0], h[2][1], h[2][2]]);
        (column, m[5], bias.linear.0[2])
    } else {
        let column = Vector6::from_array([h[0][2], h[1][2], h[2][2], j[2], j[4], j[5]]);
        (column, j[5], bias.angular.0[2])
    }
}

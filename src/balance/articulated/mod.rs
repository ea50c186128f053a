//! The articulated-body form: accelerations in O(n), the form that steps. `[RF08 ch. 7]`, `[McM95]`
//!
//! It solves the same balance as the closed form. Written in the frame that moves with the water: there rigid and
//! added inertia obey one law, with the twist V relative to the water (a uniform steady current changes nothing but
//! the reader's point of view). If the current accelerates by a_c, that frame accelerates with it: `g - a_c` takes the
//! place of g, in weight as in buoyancy.
//!
//! ```text
//! configure   inward    U = A E,  D = E^T U,   A_p += Ad^-T (A - U U^T / D) Ad^-1
//! respond     outward   V_i = Ad^-1 V_p + E q',   p_i = B V_i - F_i,   c_i = ad_V_i E q'
//!             inward    u = tau - E^T p,   p_p += Ad^-T (p + (A - U U^T / D) c + U u / D)
//!             base      A_0 V_0' = -p_0
//!             outward   q'' = (u - U^T (Ad^-1 V_p' + c)) / D,   V_i' = Ad^-1 V_p' + c + E q''
//! ```
//!
//! What depends on the configuration alone is a pass of its own: it can serve several velocities.

mod link;

pub use link::Scratch;
pub(crate) use link::Link;
use link::Base;

use super::joint_torque::joint_torque;
use crate::lane::{Lane, Param, sin_cos};
use crate::lie::{Vector3, Vector6};
use crate::spatial::SpatialInertia;
use crate::system::{BodyTerms, Constant, JOINTS, JointTerms, System};

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

/// `ad_V E q'`: `[v x e_z; omega x e_z] q'` for a turning joint, `[omega x e_z; 0] q'` for a sliding one.
#[inline(always)]
pub(super) fn velocity_product<L: Lane>(slides: bool, twist: Vector6<L>, qd: L) -> Vector6<L> {
    let (v, w) = (twist.linear.0, twist.angular.0);
    let across = Vector3([w[1] * qd, -(w[0] * qd), L::zero()]);
    if slides {
        Vector6 { linear: across, angular: Vector3::zero() }
    } else {
        Vector6 { linear: Vector3([v[1] * qd, -(v[0] * qd), L::zero()]), angular: across }
    }
}

/// `B V - restoring - drag`: what a body's own motion and the water ask for.
#[inline(always)]
pub(super) fn body_bias<L: Lane, P: Param<L>>(
    body: &BodyTerms<P>,
    twist: Vector6<L>,
    gravity: Vector3<L>,
) -> Vector6<L> {
    let (mut bias, rest) = match (&body.principal, &body.drag[..]) {
        (Some(principal), [_, rest @ ..]) => (principal.bias(twist), rest),
        (_, drag) => (body.inertia.get().bias_wrench(twist), drag),
    };
    for drag in rest {
        bias = bias - drag.wrench(twist);
    }
    if let Some(restoring) = &body.restoring {
        bias = restoring.subtract(gravity, bias);
    }
    bias
}

/// Places the links: their screws and gravity.
#[inline(always)]
pub(super) fn place<L: Lane, P: Param<L>>(
    joints: &[JointTerms<P>],
    gravity: Vector3<L>,
    q: &[L; JOINTS],
    links: &mut [Link<L>],
) {
    let mut gravity = gravity;
    for (i, (joint, link)) in joints.iter().zip(links.iter_mut()).enumerate() {
        let coordinate = joint.offset.get() + q[i];
        link.screw = match joint.constant {
            Constant::Shift(_) => sin_cos(coordinate).into(),
            Constant::Turn(..) => [coordinate; 2],
        };
        gravity = link.screw(joint).rotate_back(Base::of(&joint.stand).rotate_back(gravity));
        link.gravity = gravity;
    }
}

/// The part that depends on the configuration alone.
#[inline(always)]
pub fn configure<L: Lane, P: Param<L>>(
    system: &System<P>,
    gravity: Vector3<L>,
    q: &[L; JOINTS],
    scratch: &mut Scratch<L>,
) {
    let joints = system.joints.as_slice();
    let links = &mut scratch.links[..joints.len()];
    place(joints, gravity, q, links);
    // Inertia of the links already done, as the body at hand feels it.
    let mut carried = SpatialInertia::zero();
    for (joint, link) in joints.iter().zip(links.iter_mut()).rev() {
        let own: SpatialInertia<L> = joint.body.inertia.get();
        let inertia = own.plus(&carried);
        let screw = link.screw(joint);
        let felt = match joint.constant {
            Constant::Shift(_) => {
                (link.rest, link.share, link.over_d) = inertia.free_to_turn();
                screw.turning_inertia_to_parent(&link.rest)
            }
            Constant::Turn(..) => {
                (link.rest, link.share, link.over_d) = inertia.free_to_slide();
                screw.inertia_to_parent(&link.rest)
            }
        };
        carried = Base::of(&joint.stand).inertia(&felt);
    }
    if !system.fixed {
        let own: SpatialInertia<L> = system.vehicle.inertia.get();
        scratch.base = own.plus(&carried).factored();
    }
}

/// Accelerations in the configuration that was last handed to [`configure`]: `V'`, V relative to the water, and `q''`;
/// entries of `qdd` past the joint count are untouched.
#[inline(always)]
pub fn respond<L: Lane, P: Param<L>>(
    system: &System<P>,
    at: &Instant<L>,
    loads: &Loads<L>,
    scratch: &mut Scratch<L>,
    twist_rate: &mut Vector6<L>,
    qdd: &mut [L; JOINTS],
) {
    let Instant { gravity, twist, q, qd, wrench, held_rate, time } = *at;
    let joints = system.joints.as_slice();
    let links = &mut scratch.links[..joints.len()];

    let mut moving = twist;
    for (i, (joint, link)) in joints.iter().zip(links.iter_mut()).enumerate() {
        moving = link.twist_from_parent(joint, moving);
        match joint.constant {
            Constant::Shift(_) => moving.angular.0[2] += qd[i],
            Constant::Turn(..) => moving.linear.0[2] += qd[i],
        }
        link.twist = moving;
        link.bias = body_bias(&joint.body, moving, link.gravity);
        if loads.on_links {
            link.bias = link.bias - loads.links[i];
        }
        link.torque = joint_torque(joint, q[i], qd[i], loads.torque[i], loads.target(i, time));
    }

    // What the links already done ask of the body at hand.
    let mut carried = Vector6::zero();
    for (i, (joint, link)) in joints.iter().zip(links.iter_mut()).enumerate().rev() {
        let bias = link.bias + carried;
        let c = velocity_product(joint.slides(), link.twist, qd[i]);
        let wrench = match joint.constant {
            Constant::Shift(_) => {
                let u = link.torque - bias.angular.0[2];
                link.torque = u * link.over_d;
                link.rest.apply_across(c, link.share.scale_add(u, bias))
            }
            Constant::Turn(..) => {
                let u = link.torque - bias.linear.0[2];
                link.torque = u * link.over_d;
                link.rest.apply(c) + link.share.scale_add(u, bias)
            }
        };
        carried = link.wrench_to_parent(joint, wrench);
    }

    *twist_rate = if system.fixed {
        Vector6 { linear: held_rate, angular: Vector3::zero() }
    } else {
        scratch.base.solve(wrench - (body_bias(&system.vehicle, twist, gravity) + carried))
    };

    outward_rates(joints, links, qd, *twist_rate, qdd);
}

/// The last pass: `q''` from `V'`.
#[inline(always)]
pub(super) fn outward_rates<L: Lane, P: Param<L>>(
    joints: &[JointTerms<P>],
    links: &[Link<L>],
    qd: &[L; JOINTS],
    twist_rate: Vector6<L>,
    qdd: &mut [L; JOINTS],
) {
    let mut rate = twist_rate;
    for (i, (joint, link)) in joints.iter().zip(links.iter()).enumerate() {
        rate = link.twist_from_parent(joint, rate) + velocity_product(joint.slides(), link.twist, qd[i]);
        let acceleration = link.torque - link.share.dot(rate);
        match joint.constant {
            Constant::Shift(_) => rate.angular.0[2] += acceleration,
            Constant::Turn(..) => rate.linear.0[2] += acceleration,
        }
        qdd[i] = acceleration;
    }
}

/// Works out `V'` and `q''`: [`configure`], then [`respond`].
#[inline(always)]
pub fn accelerations<L: Lane, P: Param<L>>(
    system: &System<P>,
    at: &Instant<L>,
    loads: &Loads<L>,
    scratch: &mut Scratch<L>,
    twist_rate: &mut Vector6<L>,
    qdd: &mut [L; JOINTS],
) {
    configure(system, at.gravity, at.q, scratch);
    respond(system, at, loads, scratch, twist_rate, qdd);
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
    let links = &mut scratch.links[..joints.len()];
    place(joints, Vector3::zero(), q, links);
    let mut twist = twist;
    for (i, (joint, link)) in joints.iter().zip(links.iter()).enumerate() {
        twist = link.twist_from_parent(joint, twist);
        match joint.constant {
            Constant::Shift(_) => twist.angular.0[2] += qd[i],
            Constant::Turn(..) => twist.linear.0[2] += qd[i],
        }
        twists[i] = twist;
    }
}

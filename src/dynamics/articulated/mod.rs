//! The articulated-body form: accelerations in O(n), the form that steps. `[RF08 ch. 7]`, `[McM95]`
//!
//! It solves the same balance as the closed form. Written in the frame that moves with the water: there rigid and
//! added inertia obey one law, with the twist V relative to the water (a uniform steady current changes nothing but
//! the reader's point of view). If the current accelerates by a_c, that frame accelerates with it: `g - a_c` takes the
//! place of g, in weight as in buoyancy.
//!
//! ```text
//! outward   V_i = Ad^-1 V_p + E q',   p_i = B V_i - F_i,   c_i = ad_V_i E q'
//! inward    U = A E,   D = E^T U,   R = A - U U^T / D,   p_i += R c,   A_p += Ad^-T R Ad^-1
//! inward    u = tau - E^T p,   p_p += Ad^-T (p + U u / D)
//! base      A_0 V_0' = -p_0
//! outward   q'' = (u - U^T (Ad^-1 V_p' + c)) / D,   V_i' = Ad^-1 V_p' + c + E q''
//! ```
//!
//! R c has no part along the joint, so that u does not tell when it was added. Inertias and wrenches go inward together:
//! what one joint leaves behind is at hand for the next, and both chains are waited for at once.

mod link;

pub(crate) use link::Link;
pub use link::Scratch;

use std::hint::cold_path;

use super::joint_torque::joint_torque;
use crate::lane::{Lane, Param, sin_cos, sin_cos_near};
use crate::lie::{Vector3, Vector6};
use crate::spatial::{SpatialInertia, screw_z};
use crate::system::{BodyTerms, JOINTS, JointScrew, JointTerms, System};

/// Forces at the joints and on the links besides those of the system itself; held over a control period.
#[derive(Debug, Clone, Copy)]
pub struct Loads<L> {
    /// Actuator torques.
    pub torque: [L; JOINTS],
    /// Coefficients of servo targets that count; none where the joint servos are off.
    pub terms: usize,
    /// Servo targets, as cubic polynomials in the time, constant term first. The first two coefficients always count.
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
            terms: 0,
            target: [[L::zero(); 4]; JOINTS],
            on_links: false,
            links: [Vector6::zero(); JOINTS],
        }
    }

    /// Servo target of joint `i`: value and rate at `time`.
    #[inline(always)]
    pub(super) fn target(&self, i: usize, time: L) -> Option<(L, L)> {
        if self.terms == 0 {
            return None;
        }
        let [a, b, c, d] = self.target[i];
        if self.terms <= 2 {
            return Some((b.mul_add(time, a), b));
        }
        // By Horner's rule, the rate from the value's partial sums.
        let two = d.mul_add(time, c);
        let one = two.mul_add(time, b);
        Some((one.mul_add(time, a), d.mul_add(time, two).mul_add(time, one)))
    }
}

/// One instance (per lane) at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Instant<'a, L> {
    /// Whether a step starts here: the instants up to the next start belong to it.
    pub is_start: bool,
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

/// `c = ad_V E q'`: `[v x e_z; omega x e_z] q'` for a turning joint, `[omega x e_z; 0] q'` for a sliding one; x and y of
/// both parts.
#[inline(always)]
fn velocity_product<L: Lane>(slides: bool, twist: Vector6<L>, qd: L) -> [L; 4] {
    let (v, w) = (twist.linear.0, twist.angular.0);
    let (x, y) = (w[1] * qd, -(w[0] * qd));
    if slides {
        cold_path();
        return [x, y, L::zero(), L::zero()];
    }
    [v[1] * qd, -(v[0] * qd), x, y]
}

/// [`velocity_product`] with its zeros.
#[inline(always)]
pub(super) fn whole<L: Lane>([vx, vy, wx, wy]: [L; 4]) -> Vector6<L> {
    Vector6 { linear: Vector3([vx, vy, L::zero()]), angular: Vector3([wx, wy, L::zero()]) }
}

/// `V + E q'`
#[inline(always)]
pub(super) fn along<L: Lane, P: Copy, B>(joint: &JointTerms<P, B>, mut twist: Vector6<L>, qd: L) -> Vector6<L> {
    match joint.screw {
        JointScrew::Revolute { .. } => twist.angular.0[2] += qd,
        JointScrew::Prismatic { .. } => {
            cold_path();
            twist.linear.0[2] += qd;
        }
    }
    twist
}

/// `B V - restoring - drag`: what a body's own motion and the water ask for. (Written where it belongs at once: values
/// that meet after a branch would go through memory besides.)
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
        // (Those of all instances bear none.)
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

/// Places the links: their screws. What follows a start within a step is likely to be near it.
#[inline(always)]
pub(super) fn place<L: Lane, P: Param<L>, B>(
    joints: &[JointTerms<P, B>],
    is_start: bool,
    q: &[L; JOINTS],
    links: &mut [Link<L>],
) {
    for (i, (joint, link)) in joints.iter().zip(links.iter_mut()).enumerate() {
        let coordinate = joint.offset.get() + q[i];
        link.screw = match joint.screw {
            JointScrew::Revolute { .. } if is_start => {
                let (sin, cos) = sin_cos(coordinate);
                link.start = [coordinate, sin, cos];
                [sin, cos]
            }
            JointScrew::Revolute { .. } => sin_cos_near(coordinate, link.start).into(),
            JointScrew::Prismatic { .. } => {
                cold_path();
                [coordinate; 2]
            }
        };
    }
}

/// Works out `V'`, V relative to the water, and `q''`; entries of `qdd` past the joint count are untouched.
#[inline(always)]
pub fn accelerations<L: Lane, P: Param<L>, B: Param<L>>(
    system: &System<P, B>,
    at: &Instant<L>,
    loads: &Loads<L>,
    scratch: &mut Scratch<L>,
    twist_rate: &mut Vector6<L>,
    qdd: &mut [L; JOINTS],
) {
    let Instant { is_start, gravity, twist, q, qd, .. } = *at;
    let joints = system.chain();
    let links = &mut scratch.links[..joints.len()];

    place(joints, is_start, q, links);
    let (mut pull, mut moving) = (gravity, twist);
    // Twice, as the common kind of links needs no branch, and with that no way through memory.
    if system.z_aligned {
        for (i, (joint, link)) in joints.iter().zip(links.iter_mut()).enumerate() {
            (pull, moving) = link.outward(joint, pull, moving, qd[i]);
            if let Some(central) = &joint.body.central {
                central.bias_z_aligned(moving, pull, &mut link.bias);
            }
        }
        // The last link alone may bear a payload.
        if let (Some(joint), Some(link)) = (joints.last(), links.last_mut())
            && let (Some(payload), false) = (&joint.body.payload, B::SHARED)
        {
            payload.add_bias(moving, pull, &mut link.bias);
        }
    } else {
        for (i, (joint, link)) in joints.iter().zip(links.iter_mut()).enumerate() {
            (pull, moving) = link.outward(joint, pull, moving, qd[i]);
            body_bias::<_, _, false>(&joint.body, moving, pull, &mut link.bias);
        }
    }
    if loads.on_links {
        for (link, load) in links.iter_mut().zip(&loads.links) {
            link.bias = link.bias - *load;
        }
    }

    if system.sparse {
        inward::<_, _, _, true>(system, at, loads, links, twist_rate);
    } else {
        inward::<_, _, _, false>(system, at, loads, links, twist_rate);
    }

    let mut rate = *twist_rate;
    for ((joint, link), qdd) in joints.iter().zip(links.iter()).zip(qdd) {
        rate = link.twist_from_parent(joint, rate);
        let ([mut vx, mut vy, vz], [mut wx, mut wy, wz]) = (rate.linear.0, rate.angular.0);
        (vx, vy) = (vx + link.across[0], vy + link.across[1]);
        (wx, wy) = (wx + link.across[2], wy + link.across[3]);
        let ([sx, sy, sz], [tx, ty, tz]) = (link.share.linear.0, link.share.angular.0);
        // What a link does along its joint is `(u - U^T ...) / D`, whatever its parent does there. In two sums, and first what
        // the joint does not turn, as the joints wait for each other here.
        let first = if joint.is_prismatic() {
            cold_path();
            tz.neg_mul_add(wz, link.torque)
        } else {
            sz.neg_mul_add(vz, link.torque)
        };
        let does = tx.neg_mul_add(wx, sx.neg_mul_add(vx, first)) - ty.mul_add(wy, sy * vy);
        // (Both entries anew: a reference to one of them would send both through memory.)
        let (vz, wz, more) = if joint.is_prismatic() {
            cold_path();
            (does, wz, does - vz)
        } else {
            (vz, does, does - wz)
        };
        *qdd = more;
        rate = Vector6 { linear: Vector3([vx, vy, vz]), angular: Vector3([wx, wy, wz]) };
    }
}

/// The inward pass and the base: `V'`, and what the joints need to follow it.
#[inline(always)]
fn inward<L: Lane, P: Param<L>, B: Param<L>, const SPARSE: bool>(
    system: &System<P, B>,
    at: &Instant<L>,
    loads: &Loads<L>,
    links: &mut [Link<L>],
    twist_rate: &mut Vector6<L>,
) {
    let Instant { gravity, twist, q, qd, wrench, held_rate, time, .. } = *at;
    let joints = system.chain();
    // What the links already done ask of the body at hand: inertia, and a wrench.
    let (mut carried, mut asked) = (SpatialInertia::zero(), Vector6::zero());
    for (i, (joint, link)) in joints.iter().zip(links.iter_mut()).enumerate().rev() {
        let torque = joint_torque(joint, q[i], qd[i], loads.torque[i], loads.target(i, time));
        let inertia = carried.plus_own::<_, SPARSE>(&joint.body.inertia);
        let mut wrench = link.bias + asked;
        // Nothing but its torque passes a joint along its axis.
        let (felt, meant) = match joint.screw {
            JointScrew::Revolute { d } => {
                let screw = screw_z(link.screw[0], link.screw[1], d);
                let (rest, share, over_d) = inertia.eliminate_revolute();
                link.share.linear = share.linear;
                (link.share.angular.0[0], link.share.angular.0[1]) = (share.angular.0[0], share.angular.0[1]);
                let u = torque - wrench.angular.0[2];
                link.torque = u * over_d;
                rest.apply_across(link.across, &mut wrench);
                wrench = share.scale_add(u, wrench);
                wrench.angular.0[2] = torque;
                (screw.turning_inertia_to_parent(&rest), screw.co_adjoint_apply_inverse(wrench))
            }
            JointScrew::Prismatic { sin, cos } => {
                cold_path();
                let screw = screw_z(sin, cos, Some(link.screw[0]));
                let (rest, share, over_d) = inertia.eliminate_prismatic();
                link.share = share;
                let u = torque - wrench.linear.0[2];
                link.torque = u * over_d;
                wrench = share.scale_add(u, rest.apply(whole(link.across)) + wrench);
                wrench.linear.0[2] = torque;
                (screw.inertia_to_parent(&rest), screw.co_adjoint_apply_inverse(wrench))
            }
        };
        (carried, asked) = (joint.placement.inertia_to_parent(&felt), joint.placement.wrench_to_parent(meant));
    }

    *twist_rate = if system.fixed {
        Vector6 { linear: held_rate, angular: Vector3::zero() }
    } else {
        let mut bias = Vector6::zero();
        body_bias::<_, _, SPARSE>(&system.vehicle, twist, gravity, &mut bias);
        carried.plus_own::<_, SPARSE>(&system.vehicle.inertia).solve(wrench - (bias + asked))
    };
}

/// Twist of each link in its joint's frame, relative to what `twist` of the vehicle is relative to.
#[inline(always)]
pub fn link_twists<L: Lane, P: Param<L>, B>(
    system: &System<P, B>,
    twist: Vector6<L>,
    q: &[L; JOINTS],
    qd: &[L; JOINTS],
    scratch: &mut Scratch<L>,
    twists: &mut [Vector6<L>],
) {
    let joints = system.chain();
    let links = &mut scratch.links[..joints.len()];
    place(joints, true, q, links);
    let mut twist = twist;
    for (((joint, link), qd), to) in joints.iter().zip(links.iter()).zip(qd).zip(twists) {
        twist = along(joint, link.twist_from_parent(joint, twist), *qd);
        *to = twist;
    }
}

//! The articulated-body form of linearly implicit Euler: `(I - h J) k = f` in O(n).
//!
//! With `y = (Theta, q; V, q')` a step of linearly implicit Euler is `y + h k`. J may be any matrix without spoiling
//! the method's order, and here it is `[[0, I], [-M^-1 K, -M^-1 D]]` with symmetric D, K >= 0:
//! secants of drag, restoring forces, friction, servos, station keeping and end stops, or bounds of them. That leaves
//!
//! ```text
//! (M + h D + h^2 K) [V'; q''] = (forces at the present rates, at the pose that these lead to in the time h)
//! ```
//!
//! D and K belong to bodies or to joints, and a body's displacement composes of the vehicle's and the joints' as its twist
//! does, so the recursion of [`super::articulated`] solves this with `A_i + h D_i + h^2 K_i` for each body's inertia and
//! `h (d + h k)` added to each joint's. (h D_i meets the whole `V_i'`, products of velocities included, for that is how
//! much the body's twist changes.) No pivot is ever less than the explicit form's.

use super::articulated::{Instant, Loads, Scratch, along, body_bias, place, whole};
use super::joint_torque::implicit_joint_torque;
use crate::lane::{Lane, Param};
use crate::lie::{Matrix3, Vector3, Vector6};
use crate::spatial::SpatialInertia;
use crate::system::{BodyTerms, JOINTS, JointScrew, System};

/// How far ahead forces are taken.
#[derive(Debug, Clone, Copy)]
pub struct Ahead<L> {
    /// The step size. [`Instant::time`] is already that of the step's end.
    pub h: L,
    /// Whether [`Instant::wrench`] holds that of the vehicle's servo.
    pub station: bool,
}

/// `A + h D + h^2 K` of a body, and its bias at the pose that the present twist leads to.
#[inline(always)]
fn effective<L: Lane, B: Param<L>>(
    body: &BodyTerms<B>,
    h: L,
    twist: Vector6<L>,
    gravity: Vector3<L>,
) -> (SpatialInertia<L>, Vector6<L>) {
    let mut inertia: SpatialInertia<L> = body.inertia.get();
    let mut bias = Vector6::zero();
    body_bias::<_, _, false>(body, twist, gravity, &mut bias);
    for damping in &body.damping {
        inertia = damping.damping_matrix(twist).scale_add(h, &inertia);
    }
    if let Some(restoring) = &body.restoring {
        let stiffness = Matrix3::symmetric(&restoring.stiffness(gravity));
        bias.angular = stiffness.apply(twist.angular).scale_add(h, bias.angular);
        inertia.add_angular(h * h, &stiffness);
    }
    (inertia, bias)
}

/// Works out `V'`, V relative to the water, and `q''` of linearly implicit Euler; entries of `qdd` past the joint count are
/// untouched.
#[inline(always)]
pub fn implicit_accelerations<L: Lane, P: Param<L>, B: Param<L>>(
    system: &System<P, B>,
    at: &Instant<L>,
    ahead: Ahead<L>,
    loads: &Loads<L>,
    scratch: &mut Scratch<L>,
    twist_rate: &mut Vector6<L>,
    qdd: &mut [L; JOINTS],
) {
    let Instant { gravity, twist, q, qd, wrench, held_rate, time, .. } = *at;
    let Ahead { h, station } = ahead;
    let joints = system.chain();
    let links = &mut scratch.links[..joints.len()];
    place(joints, true, q, links);
    let (mut pull, mut moving) = (gravity, twist);
    for i in 0..joints.len() {
        let (joint, link) = (&joints[i], &mut links[i]);
        (pull, moving) = link.outward(joint, pull, moving, qd[i]);
        (link.gravity, link.twist) = (pull, moving);
    }

    let mut carried = (SpatialInertia::zero(), Vector6::zero());
    for i in (0..joints.len()).rev() {
        let (joint, link) = (&joints[i], &mut links[i]);
        let (own, mut bias) = effective(&joint.body, h, link.twist, link.gravity);
        if loads.on_links {
            bias = bias - loads.links[i];
        }
        let inertia = own.plus(&carried.0);
        bias = bias + carried.1;
        let (column, along) = match joint.screw {
            JointScrew::Revolute { .. } => (inertia.column::<5>(), bias.angular.0[2]),
            JointScrew::Prismatic { .. } => (inertia.column::<2>(), bias.linear.0[2]),
        };
        let d = match joint.screw {
            JointScrew::Revolute { .. } => column.angular.0[2],
            JointScrew::Prismatic { .. } => column.linear.0[2],
        };
        let (torque, falls) = implicit_joint_torque(joint, h, q[i], qd[i], loads.torque[i], loads.target(i, time));
        let over_d = L::c(1.0) / (d + falls);
        (link.share, link.torque) = (column.scale(over_d), (torque - along) * over_d);

        let rest = inertia.eliminated(column, over_d);
        let wrench = rest.apply(whole(link.across)) + column.scale_add(link.torque, bias);
        carried = (link.inertia_to_parent(joint, &rest), link.wrench_to_parent(joint, wrench));
    }

    if system.fixed {
        *twist_rate = Vector6 { linear: held_rate, angular: Vector3::zero() };
    } else {
        let (own, bias) = effective(&system.vehicle, h, twist, gravity);
        let mut inertia = own.plus(&carried.0);
        let mut force = (wrench - (bias + carried.1)).to_array();
        if let (true, Some(gains)) = (station, &system.vehicle_servo) {
            let rate = twist.to_array();
            for i in 0..6 {
                let spring = gains.kp[i].get() * h;
                force[i] = spring.neg_mul_add(rate[i], force[i]);
                inertia.add_diagonal(i, (gains.kd[i].get() + spring) * h);
            }
        }
        *twist_rate = inertia.solve(Vector6::from_array(force));
    }

    let mut rate = *twist_rate;
    for (i, (joint, link)) in joints.iter().zip(links.iter()).enumerate() {
        rate = link.twist_from_parent(joint, rate) + whole(link.across);
        qdd[i] = link.torque - link.share.dot(rate);
        rate = along(joint, rate, qdd[i]);
    }
}

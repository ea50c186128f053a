//! Joint torque of actuator, servo, friction, springs, detents and end stops, in lanes.

use std::hint::cold_path;

use crate::lane::{Lane, Param, get_all, inverse_sqrt, sin_cos};
use crate::system::{Detent, JointTerms};

/// Torque along +q, N m or N. `command` is the actuator's, `target` the servo's `(q_d, q_d')` if it is on.
#[inline(always)]
pub fn joint_torque<L: Lane, P: Param<L>, B>(
    joint: &JointTerms<P, B>,
    q: L,
    qd: L,
    command: L,
    target: Option<(L, L)>,
) -> L {
    let mut torque = command;
    if let (Some(servo), Some((position, rate))) = (&joint.servo, target) {
        torque = servo.kp.get().mul_add(position - q, servo.kd.get().mul_add(rate - qd, torque));
    }
    if let Some(effort) = joint.effort {
        torque = torque.min(effort.get()).max(-effort.get());
    }
    if let Some(rare) = &joint.rare {
        cold_path();
        if let Some(actuator) = &rare.actuator {
            let effort: L = actuator.effort(q);
            torque = torque.min(effort).max(-effort);
        }
        if let Some([stiffness, rest]) = rare.spring {
            torque = stiffness.get().neg_mul_add(q - rest.get(), torque);
        }
        if let Some(Detent { torque: maximum, rate, offset }) = rare.detent {
            torque = maximum.get().neg_mul_add(sin_cos(rate.get() * (q - offset.get())).0, torque);
        }
        if let Some(break_away) = &rare.break_away {
            torque = break_away.slope(qd).neg_mul_add(qd, torque);
        }
    }
    if let Some(friction) = &joint.friction {
        torque = friction.viscous.get().neg_mul_add(qd, torque);
        if let Some([coulomb, speed_squared]) = friction.coulomb {
            torque = (coulomb.get() * qd).neg_mul_add(inverse_sqrt(qd.mul_add(qd, speed_squared.get())), torque);
        }
    }
    if let Some(limits) = &joint.limits {
        let [lower, upper] = get_all(&limits.range);
        let [stiffness, damping] = get_all(&limits.stop);
        let excess = q - q.max(lower).min(upper);
        torque = stiffness.neg_mul_add(excess, (damping * excess.abs()).neg_mul_add(qd, torque));
    }
    torque
}

/// Rate that a linearly implicit step of size `h` lost or gained of a joint of this inertia at an end stop, where `h` times the frequency
/// of the joint at the stop is beyond `range`; from coordinates and rates at its start and its end.
///
/// The rate is the joint's rate outside of its stop: `sqrt(q'^2 + k/m p^2)` from a depth p. A stop returns `1 / (1 + c v / k)`
/// of a rate v, within a tenth; the damping d of friction and servo leaves `(1 - zeta)^3` of it, with `zeta = d / (2 sqrt(k m))`,
/// within 0.04.
#[inline(always)]
pub fn lost_bounce<L: Lane, P: Param<L>, B>(
    joint: &JointTerms<P, B>,
    (h, range): (L, f64),
    inertia: L,
    servo_on: bool,
    [start, end]: [(L, L); 2],
) -> L {
    let (zero, one) = (L::zero(), L::c(1.0));
    let (Some(limits), false) = (&joint.limits, joint.prescribed) else { return zero };
    let [lower, upper]: [L; 2] = get_all(&limits.range);
    let [stiffness, damping]: [L; 2] = get_all(&limits.stop);
    let ahead = h.mul_add(start.1, start.0);
    let depth = start.0 - start.0.max(lower).min(upper);
    let depth_ahead = ahead - ahead.max(lower).min(upper);
    let depth_end = end.0 - end.0.max(lower).min(upper);
    let square = stiffness / inertia;
    let before = start.1.mul_add(start.1, square * depth * depth).sqrt();
    let after = end.1.mul_add(end.1, square * depth_end * depth_end).sqrt();
    let mut drag = zero;
    if let Some(friction) = &joint.friction {
        drag = friction.viscous.get();
    }
    if let (Some(servo), true) = (&joint.servo, servo_on) {
        drag += servo.kd.get();
    }
    let left = zero.max(one - L::c(0.5) * drag / (stiffness * inertia).sqrt());
    let returned = left * left * left * stiffness / damping.mul_add(before, stiffness);
    let lost = before.mul_add(returned, -after).max(after - before).max(zero);
    let hits = L::and(zero.lt(depth.abs() + depth_ahead.abs()), L::c(range * range).lt(square * h * h));
    L::select(hits, lost, zero)
}

/// Torque at the coordinate after a time `h` at the present rate, with the servo's `target` at that time; and its decrease
/// per unit of acceleration over that time, `h (d + h k)` with the secants d and k of the torque in rate and coordinate.
/// d and k are never negative.
#[inline(always)]
pub fn implicit_joint_torque<L: Lane, P: Param<L>, B>(
    joint: &JointTerms<P, B>,
    h: L,
    q: L,
    qd: L,
    command: L,
    target: Option<(L, L)>,
) -> (L, L) {
    let ahead = h.mul_add(qd, q);
    let (mut torque, mut decrease) = (command, L::zero());
    if let (Some(servo), Some((position, rate))) = (&joint.servo, target) {
        let (kp, kd) = (servo.kp.get(), servo.kd.get());
        torque = kp.mul_add(position - ahead, kd.mul_add(rate - qd, torque));
        decrease = h.mul_add(kp, kd) * h;
    }
    if let Some(effort) = joint.effort {
        // Beyond the effort, the secant from the present demand to where the demand vanishes.
        let effort = effort.get();
        let demand = torque.abs();
        decrease = decrease * L::select(effort.lt(demand), effort / demand, L::c(1.0));
        torque = torque.min(effort).max(-effort);
    }
    if let Some(rare) = &joint.rare {
        cold_path();
        if let Some(actuator) = &rare.actuator {
            let (effort, demand): (L, L) = (actuator.effort(ahead), torque.abs());
            decrease = decrease * L::select(effort.lt(demand), effort / demand, L::c(1.0));
            torque = torque.min(effort).max(-effort);
        }
        if let Some([stiffness, rest]) = rare.spring {
            torque = stiffness.get().neg_mul_add(ahead - rest.get(), torque);
            decrease = (h * stiffness.get()).mul_add(h, decrease);
        }
        if let Some(Detent { torque: maximum, rate, offset }) = rare.detent {
            let (sin, cos) = sin_cos(rate.get() * (ahead - offset.get()));
            torque = maximum.get().neg_mul_add(sin, torque);
            // The tangent, where it is a stiffness: a detent pushes away from the middle between its resting places.
            let stiffness = (maximum.get() * rate.get() * cos).max(L::zero());
            decrease = (h * stiffness).mul_add(h, decrease);
        }
        if let Some(break_away) = &rare.break_away {
            let slope: L = break_away.slope(qd);
            torque = slope.neg_mul_add(qd, torque);
            decrease = slope.mul_add(h, decrease);
        }
    }
    if let Some(friction) = &joint.friction {
        let mut slope = friction.viscous.get();
        if let Some([coulomb, speed_squared]) = friction.coulomb {
            slope = coulomb.get().mul_add(inverse_sqrt(qd.mul_add(qd, speed_squared.get())), slope);
        }
        torque = slope.neg_mul_add(qd, torque);
        decrease = slope.mul_add(h, decrease);
    }
    if let Some(limits) = &joint.limits {
        let [lower, upper] = get_all(&limits.range);
        let [stiffness, damping] = get_all(&limits.stop);
        let excess = ahead - ahead.max(lower).min(upper);
        let depth = excess.abs();
        torque = stiffness.neg_mul_add(excess, (damping * depth).neg_mul_add(qd, torque));
        let spring = L::select(L::zero().lt(depth), stiffness, L::zero());
        decrease = h.mul_add(spring, damping * depth).mul_add(h, decrease);
    }
    (torque, decrease)
}

//! Force of a contact from the motion of a sphere relative to a shape, and its adjoint.

use super::{Distance, Geometry, Law};
use crate::lane::{Dual, Lane, Param};
use crate::lie::{Vector3, Vector6};

/// Place and motion of a sphere's centre relative to a shape, in the shape's axes.
#[derive(Debug, Clone, Copy)]
pub struct RelativeMotion<L> {
    /// Centre in the shape's frame, m.
    pub center: Vector3<L>,
    /// Velocity of the sphere's body less that of the shape's body, both at the centre, m/s, and their difference in spin, rad/s.
    pub twist: Vector6<L>,
}

/// A contact.
#[derive(Debug, Clone, Copy)]
pub struct ContactForce<L> {
    /// Penetration, m; negative where they are apart.
    pub depth: L,
    /// Rate of penetration, m/s.
    pub rate: L,
    /// Outward normal of the shape.
    pub normal: Vector3<L>,
    /// Point where the force acts, the middle of the penetration, relative to the sphere's centre, m.
    pub arm: Vector3<L>,
    /// Normal force, N.
    pub normal_force: L,
    /// Friction over the sliding velocity, N s/m.
    pub drag: L,
    /// Force on the sphere and its moment about the sphere's centre, shape axes, N and N m.
    pub wrench: Vector6<L>,
}

/// Force of a contact between a sphere of this radius and a shape, at the depth after a time `h` at the present rate.
#[inline(always)]
pub fn contact_force<L: Lane, P: Param<L>>(
    geometry: &Geometry<P>,
    law: &Law<P>,
    radius: L,
    motion: &RelativeMotion<L>,
    h: L,
) -> ContactForce<L> {
    let Distance { distance, normal } = geometry.distance(motion.center);
    let depth = radius - distance;
    let arm = normal.scale(depth.mul_add(L::c(0.5), -radius));
    let velocity = motion.twist.angular.cross_add(arm, motion.twist.linear);
    let rate = -normal.dot(velocity);
    let normal_force = law.normal_force(h.mul_add(rate, depth), rate);
    let slip = normal.scale_add(rate, velocity);
    let speed = (slip.dot(slip) + law.slip_speed_squared.get()).sqrt();
    let drag = law.friction.get() * normal_force / speed;
    let force = slip.scale_add(-drag, normal.scale(normal_force));
    let wrench = Vector6 { linear: force, angular: arm.cross(force) };
    ContactForce { depth, rate, normal, arm, normal_force, drag, wrench }
}

/// Force over the acceleration that it opposes in a linearly implicit step: `h D + h^2 K`, kg.
///
/// ```text
/// K = k s' n n^T,   D = k s d n n^T + mu f / |v| (1 - n n^T)
/// ```
///
/// with s' the mean slope over the way of a step, so that no step is carried beyond rest, and the friction's secant.
#[derive(Debug, Clone, Copy)]
pub struct Resistance<L> {
    /// Along the normal.
    pub along: L,
    /// Across it.
    pub across: L,
}

impl<L: Lane> ContactForce<L> {
    /// Resistance in a step of size `h`.
    #[inline(always)]
    pub fn resistance<P: Param<L>>(&self, law: &Law<P>, h: L) -> Resistance<L> {
        let advance = h * self.rate;
        let loss = law.dissipation.get().mul_add(self.rate, L::c(1.0)).max(L::zero());
        let damping = law.effective_depth(self.depth + advance) * law.dissipation.get();
        let damping = L::select(L::zero().lt(loss), damping, L::zero());
        let stiffness = law.mean_slope(self.depth, advance) * loss;
        Resistance { along: law.stiffness.get() * h * h.mul_add(stiffness, damping), across: h * self.drag }
    }

    /// Wrench that opposes an acceleration of the sphere relative to the shape, given at the centre.
    #[inline(always)]
    pub fn opposing(&self, resistance: &Resistance<L>, acceleration: Vector6<L>) -> Vector6<L> {
        let Resistance { along, across } = *resistance;
        let point = acceleration.angular.cross_add(self.arm, acceleration.linear);
        let normal = self.normal.scale((across - along) * self.normal.dot(point));
        let force = point.scale_add(-across, normal);
        Vector6 { linear: force, angular: self.arm.cross(force) }
    }
}

/// Linearly implicit step in a contact.
#[derive(Debug, Clone, Copy)]
pub struct ContactStep<L> {
    /// Step size, s.
    pub h: L,
    /// Acceleration of the sphere relative to the shape at the sphere's centre, shape axes.
    pub acceleration: Vector6<L>,
}

/// Cotangents of the motion from the cotangent `of` of the wrench, one evaluation in dual numbers for each number; and the
/// wrench. In a linearly implicit step the wrench is less what opposes the acceleration.
#[inline(always)]
pub fn contact_force_adjoint<L: Lane>(
    geometry: &Geometry<L>,
    law: &Law<L>,
    radius: L,
    motion: &RelativeMotion<L>,
    of: Vector6<L>,
    step: Option<ContactStep<L>>,
) -> (RelativeMotion<L>, Vector6<L>) {
    let ([x, y, z], [u, v, w, p, q, r]) = (motion.center.0, motion.twist.to_array());
    let values = [x, y, z, u, v, w, p, q, r];
    let (of, zero, one) = (of.to_array(), L::zero(), L::c(1.0));
    let (mut slopes, mut wrench) = ([zero; 9], [zero; 6]);
    let mut numbers = [Dual::new(zero, zero); 9];
    for k in 0..9 {
        numbers[k].value = values[k];
    }
    let mut acceleration = [Dual::new(zero, zero); 6];
    let mut h = Dual::new(zero, zero);
    if let Some(step) = &step {
        h.value = step.h;
        let values = step.acceleration.to_array();
        for k in 0..6 {
            acceleration[k].value = values[k];
        }
    }
    for k in 0..9 {
        numbers[k].slope = one;
        let [x, y, z, u, v, w, p, q, r] = numbers;
        let motion = RelativeMotion { center: Vector3([x, y, z]), twist: Vector6::from_array([u, v, w, p, q, r]) };
        let radius = Dual::new(radius, zero);
        let force = contact_force::<Dual<L>, L>(geometry, law, radius, &motion, h);
        let mut sum = force.wrench;
        if step.is_some() {
            let resistance = force.resistance::<L>(law, h);
            sum = sum + force.opposing(&resistance, Vector6::from_array(acceleration));
        }
        let sum = sum.to_array();
        numbers[k].slope = zero;
        for i in 0..6 {
            slopes[k] = of[i].mul_add(sum[i].slope, slopes[k]);
            wrench[i] = sum[i].value;
        }
    }
    let [x, y, z, u, v, w, p, q, r] = slopes;
    let of_motion = RelativeMotion { center: Vector3([x, y, z]), twist: Vector6::from_array([u, v, w, p, q, r]) };
    (of_motion, Vector6::from_array(wrench))
}

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
    /// Normal force, N.
    pub normal_force: L,
    /// Force on the sphere and its moment about the sphere's centre, shape axes, N and N m. The force acts in the middle of the
    /// penetration.
    pub wrench: Vector6<L>,
}

/// Force of a contact between a sphere of this radius and a shape.
#[inline(always)]
pub fn contact_force<L: Lane, P: Param<L>>(
    geometry: &Geometry<P>,
    law: &Law<P>,
    radius: L,
    motion: &RelativeMotion<L>,
) -> ContactForce<L> {
    let Distance { distance, normal } = geometry.distance(motion.center);
    let depth = radius - distance;
    let arm = normal.scale(depth.mul_add(L::c(0.5), -radius));
    let velocity = motion.twist.angular.cross_add(arm, motion.twist.linear);
    let rate = -normal.dot(velocity);
    let normal_force = law.normal_force(depth, rate);
    let slip = normal.scale_add(rate, velocity);
    let speed = (slip.dot(slip) + law.slip_speed_squared.get()).sqrt();
    let drag = law.friction.get() * normal_force / speed;
    let force = slip.scale_add(-drag, normal.scale(normal_force));
    ContactForce { depth, normal_force, wrench: Vector6 { linear: force, angular: arm.cross(force) } }
}

/// Cotangents of the motion from the cotangent `of` of the wrench, one evaluation in dual numbers for each number; and the
/// wrench.
#[inline(always)]
pub fn contact_force_adjoint<L: Lane>(
    geometry: &Geometry<L>,
    law: &Law<L>,
    radius: L,
    motion: &RelativeMotion<L>,
    of: Vector6<L>,
) -> (RelativeMotion<L>, Vector6<L>) {
    let ([x, y, z], [u, v, w, p, q, r]) = (motion.center.0, motion.twist.to_array());
    let values = [x, y, z, u, v, w, p, q, r];
    let (of, zero, one) = (of.to_array(), L::zero(), L::c(1.0));
    let (mut slopes, mut wrench) = ([zero; 9], [zero; 6]);
    let mut numbers = [Dual::new(zero, zero); 9];
    for k in 0..9 {
        numbers[k].value = values[k];
    }
    for k in 0..9 {
        numbers[k].slope = one;
        let [x, y, z, u, v, w, p, q, r] = numbers;
        let motion = RelativeMotion { center: Vector3([x, y, z]), twist: Vector6::from_array([u, v, w, p, q, r]) };
        let radius = Dual::new(radius, zero);
        let force = contact_force::<Dual<L>, L>(geometry, law, radius, &motion).wrench.to_array();
        numbers[k].slope = zero;
        for i in 0..6 {
            slopes[k] = of[i].mul_add(force[i].slope, slopes[k]);
            wrench[i] = force[i].value;
        }
    }
    let [x, y, z, u, v, w, p, q, r] = slopes;
    let of_motion = RelativeMotion { center: Vector3([x, y, z]), twist: Vector6::from_array([u, v, w, p, q, r]) };
    (of_motion, Vector6::from_array(wrench))
}

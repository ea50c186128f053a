//! Adjoint of the force that moves a body: `A V' - ad_V^T A V` minus damping, weight and buoyancy, in its joint's frame.
//!
//! With the dual twist lambda: `lambda . (-ad_V^T A V) = (ad_lambda V) . A V`, whose derivative by V is
//! `ad_lambda^T A V + A ad_lambda V`.

use crate::hydro::{DampedMotion, DampedSums};
use crate::lane::Lane;
use crate::lie::{Matrix3, Vector3, Vector6, ad, ad_adjoint};
use crate::spatial::PointMass;
use crate::system::{BodyTerms, Factors, UnscaledBodyTerms};

/// Motion of a body.
#[derive(Clone, Copy)]
pub(super) struct AdjointMotion<L> {
    /// Twist V relative to the water.
    pub twist: Vector6<L>,
    /// Its rate V'.
    pub acceleration: Vector6<L>,
    /// Gravity less the acceleration of the water.
    pub gravity: Vector3<L>,
    /// Dual twist lambda.
    pub dual: Vector6<L>,
}

/// Force that moves a body, and the derivatives of its product with the dual twist.
#[derive(Debug, Clone, Copy)]
pub(super) struct BodyCotangents<L> {
    pub force: Vector6<L>,
    pub of_twist: Vector6<L>,
    pub of_acceleration: Vector6<L>,
    pub of_gravity: Vector3<L>,
}

impl<L: Lane> BodyCotangents<L> {
    /// Zeros.
    #[inline(always)]
    pub fn zero() -> Self {
        let six = Vector6::zero();
        Self { force: six, of_twist: six, of_acceleration: six, of_gravity: Vector3::zero() }
    }

    /// Sum with those of another body in the same frame.
    #[inline(always)]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            force: self.force + other.force,
            of_twist: self.of_twist + other.of_twist,
            of_acceleration: self.of_acceleration + other.of_acceleration,
            of_gravity: self.of_gravity + other.of_gravity,
        }
    }
}

/// Force and derivatives; with `IMPLICIT` for a linearly implicit method of step `h`, whose inertia contains damping and
/// stiffness.
#[inline(always)]
pub(super) fn body_adjoint<L: Lane, const IMPLICIT: bool>(
    body: &BodyTerms<L>,
    h: L,
    at: &AdjointMotion<L>,
) -> BodyCotangents<L> {
    let AdjointMotion { twist, acceleration, gravity, dual } = *at;
    let inertia = &body.inertia;
    let momentum = inertia.apply(twist);
    let (_, of_twist) = ad_adjoint(dual, twist, momentum);
    let (_, bias) = ad_adjoint(twist, twist, momentum);
    let mut sums = BodyCotangents {
        force: inertia.apply(acceleration) - bias,
        of_twist: of_twist + inertia.apply(ad(dual, twist)),
        of_acceleration: inertia.apply(dual),
        of_gravity: Vector3::zero(),
    };
    if let Some(restoring) = &body.restoring {
        sums.force = sums.force - restoring.wrench(gravity);
        sums.of_gravity = -restoring.wrench_adjoint(dual);
        if IMPLICIT {
            let stiffness = Matrix3::symmetric(&restoring.stiffness(gravity));
            let turned = turned(h, at);
            sums.force.angular = sums.force.angular + stiffness.apply(turned);
            let moment = stiffness.apply(dual.angular).scale(h);
            sums.of_twist.angular = sums.of_twist.angular + moment;
            sums.of_acceleration.angular = moment.scale_add(h, sums.of_acceleration.angular);
            let of = restoring.stiffness_adjoint(gravity, dual.angular, turned);
            sums.of_gravity = sums.of_gravity + of.of_gravity;
        }
    }
    let damped = damped_motion(h, at);
    let mut damping_sums = DampedSums { force: sums.force, of_twist: sums.of_twist, of_change: Vector6::zero() };
    for damping in &body.damping {
        damping.add_adjoint::<IMPLICIT>(&damped, &mut damping_sums);
    }
    sums.force = damping_sums.force;
    sums.of_twist = damping_sums.of_twist;
    if IMPLICIT {
        sums.of_acceleration = damping_sums.of_change.scale_add(h, sums.of_acceleration);
    }
    sums
}

#[inline(always)]
fn damped_motion<L: Lane>(h: L, at: &AdjointMotion<L>) -> DampedMotion<L> {
    DampedMotion { twist: at.twist, change: at.acceleration.scale(h), dual: at.dual }
}

/// Rotation that the stiffness acts against in the force: `h omega + h^2 omega'`.
#[inline(always)]
fn turned<L: Lane>(h: L, at: &AdjointMotion<L>) -> Vector3<L> {
    at.acceleration.angular.scale_add(h, at.twist.angular).scale(h)
}

/// Adds the cotangents of the factors on the body's parts: minus the derivatives of the product of force and dual twist.
#[inline(always)]
pub(super) fn add_factor_products<L: Lane, const IMPLICIT: bool>(
    body: &BodyTerms<L>,
    parts: &UnscaledBodyTerms<L>,
    h: L,
    at: &AdjointMotion<L>,
    of: &mut Factors<L>,
) {
    let at = &AdjointMotion { dual: -at.dual, ..*at };
    let AdjointMotion { twist, acceleration, gravity, dual } = *at;
    let product = |force: Vector6<L>| dual.dot(force);
    for (inertia, of) in [(&parts.rigid, &mut of.mass), (&parts.added, &mut of.added_mass)] {
        *of += product(inertia.apply(acceleration) + inertia.bias_wrench(twist));
    }
    of.mass -= product(parts.weight.wrench(gravity));
    of.volume += product(parts.displaced.wrench(gravity));
    let mut of_moment = Vector3::zero();
    if let (Some(restoring), true) = (&body.restoring, IMPLICIT) {
        of_moment = restoring.stiffness_adjoint(gravity, dual.angular, turned(h, at)).of_moment;
        of.mass += of_moment.dot(Vector3(parts.weight.moment));
        of.volume -= of_moment.dot(Vector3(parts.displaced.moment));
    }
    if let Some(payload) = &body.payload {
        let unit = PointMass { mass: L::c(1.0), position: payload.position };
        let mut force = unit.inertia().apply(acceleration);
        unit.add_bias(twist, gravity, &mut force);
        of.payload += product(force) + of_moment.dot(payload.position.coordinates::<L>());
    }
    let damped = damped_motion(h, at);
    for k in 0..body.damping.len().min(parts.damping.len()) {
        let [linear, quadratic] = body.damping[k].products::<IMPLICIT>(&parts.damping[k], &damped);
        of.linear_damping += linear;
        of.quadratic_damping += quadratic;
    }
}

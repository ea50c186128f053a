//! Adjoint of contact.
//!
//! With dual velocities Lambda of the bodies, the wrenches F of contacts contribute `sum Lambda . F` to the product whose derivatives
//! are cotangents ([`super::aba_adjoint`]): for each contact `f . l`, with the force f on the sphere and the dual velocity l of the sphere
//! relative to the shape, both in the shape's axes. f depends on the centre c and the relative velocity u; l depends on places as
//! u does. A displacement of the sphere's body by `xi`, `theta` at the centre moves c by `xi` and turns the velocity a of the
//! sphere's body, while the velocity b of the shape's body at the centre changes by `b_omega x xi`:
//!
//! ```text
//! xi:     g_c - sum g x b_omega          theta:  sum a x g + a_omega x g_omega        over u with g = df/du, and l with g = f
//! ```
//!
//! A displacement of the shape's body has the opposite cotangents at the same point.

use super::aba_adjoint::{AdjointScratch, InstantCotangents, along, by_coordinate};
use super::contact::{link_places, relative_motion, shape_at, sphere_at, touches};
use super::place::Place;
use crate::contact::{ContactTerms, contact_force_adjoint};
use crate::lane::{Lane, Routine};
use crate::lie::{Vector3, Vector6};
use crate::system::{JOINTS, System};

/// Cotangents of place and motion of a body, in its frame.
#[derive(Debug, Clone, Copy)]
struct BodySums<L> {
    /// Cotangent of a displacement of the body.
    displacement: Vector6<L>,
    /// Cotangent of its absolute twist.
    twist: Vector6<L>,
}

impl<L: Lane> BodySums<L> {
    #[inline(always)]
    fn zero() -> Self {
        Self { displacement: Vector6::zero(), twist: Vector6::zero() }
    }

    #[inline(always)]
    fn plus(&self, other: &Self) -> Self {
        Self { displacement: self.displacement + other.displacement, twist: self.twist + other.twist }
    }
}

/// Adds the cotangents of joint coordinates and rates, and gives the cotangents of the vehicle's place; a routine of its own.
pub struct ContactAdjoint<'a, L> {
    /// The system, with contact.
    pub system: &'a System<L>,
    /// Place of the vehicle.
    pub vehicle: Place<L>,
    /// Joint coordinates and rates.
    pub joints: (&'a [L; JOINTS], &'a [L; JOINTS]),
    /// Dual velocities of the links; working memory.
    pub memory: &'a mut AdjointScratch<L>,
    /// Dual velocity of the vehicle, and the cotangents of the joints.
    pub of_instant: &'a mut InstantCotangents<L>,
    /// Cotangent of a displacement of the vehicle, body axes.
    pub of_displacement: Vector6<L>,
    /// Cotangent of its absolute twist.
    pub of_twist: Vector6<L>,
}

impl<L: Lane> Routine<L> for ContactAdjoint<'_, L> {
    #[inline(always)]
    fn run(&mut self) {
        let Self { system, vehicle, joints: (q, qd), memory, of_instant, .. } = self;
        let Some(ContactTerms { spheres, shapes }) = &system.contact else { return };
        let joints = system.chain();
        let n = joints.len();
        let AdjointScratch { scratch, dual, .. } = &mut **memory;
        let (links, places) = (&mut scratch.links[..n], &mut scratch.contact.places);
        link_places(system, true, vehicle, (q, qd), links, places);
        let mut sums = [BodySums::zero(); JOINTS];
        let mut on_vehicle = BodySums::zero();
        for shape in shapes {
            let shape_at = shape_at(shape, places);
            for sphere in spheres {
                let sphere_at = sphere_at(sphere, vehicle, places);
                let (motion, in_body) = relative_motion(&sphere_at, &shape_at);
                if !touches(shape, sphere, motion.center, L::zero()) {
                    continue;
                }
                let ((place, point, center), (body, pose)) = (sphere_at, shape_at);
                let of_sphere = Place { twist: dual_of(sphere.body, of_instant.wrench, dual), ..place };
                let of_shape = match shape.body {
                    0 => Place::world(),
                    k => Place { twist: dual_of(k, of_instant.wrench, dual), ..body },
                };
                let (relative, _) = relative_motion(&(of_sphere, point, center), &(of_shape, pose));
                let (of, wrench) =
                    contact_force_adjoint(&shape.geometry, &shape.law, sphere.radius, &motion, relative.twist);
                // Velocities u and dual velocities l of both bodies, each with its cotangent.
                let (mut moves, mut turns) = (of.center, Vector3::zero());
                let pairs = [(&place, &body, of.twist), (&of_sphere, &of_shape, wrench)];
                for k in 0..pairs.len() {
                    let (sphere, shape, g) = pairs[k];
                    let a = pose.rotation.apply_both_transposed(sphere.motion_at(point));
                    let b = pose.rotation.apply_both_transposed(shape.motion_at(in_body));
                    moves = moves - g.linear.cross(b.angular);
                    turns = turns + a.linear.cross(g.linear) + a.angular.cross(g.angular);
                }
                let displacement = pose.rotation.apply_both(Vector6 { linear: moves, angular: turns });
                let twist = pose.rotation.apply_both(of.twist);
                let of_sphere = BodySums {
                    displacement: place.wrench_of(point, displacement),
                    twist: place.wrench_of(point, twist),
                };
                match sphere.body.checked_sub(1) {
                    Some(k) => sums[k % JOINTS] = sums[k % JOINTS].plus(&of_sphere),
                    None => on_vehicle = on_vehicle.plus(&of_sphere),
                }
                if let Some(k) = shape.body.checked_sub(1) {
                    let of_shape = BodySums {
                        displacement: body.wrench_of(in_body, -displacement),
                        twist: body.wrench_of(in_body, -twist),
                    };
                    sums[k % JOINTS] = sums[k % JOINTS].plus(&of_shape);
                }
            }
        }
        for i in (0..n).rev() {
            let (joint, link, sum) = (&joints[i], &links[i], sums[i]);
            of_instant.q[i] += along(joint, sum.displacement) + by_coordinate(joint, sum.twist, places[i].twist);
            of_instant.qd[i] += along(joint, sum.twist);
            let sum = BodySums {
                displacement: link.wrench_to_parent(joint, sum.displacement),
                twist: link.wrench_to_parent(joint, sum.twist),
            };
            match joint.carrier(i) {
                0 => on_vehicle = on_vehicle.plus(&sum),
                k if k <= n => sums[(k - 1) % JOINTS] = sums[(k - 1) % JOINTS].plus(&sum),
                _ => {}
            }
        }
        (self.of_displacement, self.of_twist) = (on_vehicle.displacement, on_vehicle.twist);
    }
}

/// Dual velocity of a body: 0 for the vehicle, k + 1 for the link of joint k.
#[inline(always)]
fn dual_of<L: Lane>(body: usize, vehicle: Vector6<L>, links: &[Vector6<L>; JOINTS]) -> Vector6<L> {
    match body.checked_sub(1) {
        Some(k) => links[k % JOINTS],
        None => vehicle,
    }
}

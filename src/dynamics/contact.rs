//! Contact: wrenches on vehicle and links, from the places and the motion of the bodies at a stage.

use std::hint::cold_path;

use super::aba::Scratch;
use super::branches::at_carrier;
use super::link::{LinkScratch, add_joint_rate, joint_screws};
use super::place::{Place, WaterFrame};
use crate::contact::{ContactForce, ContactTerms, RelativeMotion, Resistance, ShapeTerms, SphereTerms, contact_force};
use crate::lane::{Lane, Param, Routine, get_all};
use crate::lie::{Pose, Vector3, Vector6, exp_se3};
use crate::spatial::SpatialInertia;
use crate::system::{JOINTS, JointScrew, JointTerms, System, WORLD};

/// Places and motion of the bodies in the world, and the wrenches of contacts on them.
#[derive(Debug, Clone)]
pub struct ContactScratch<L> {
    /// Places of the links, each in its joint's frame.
    pub(super) places: [Place<L>; JOINTS],
    /// Wrench on the vehicle, body axes, N and N m.
    pub vehicle: Vector6<L>,
    /// Wrench on each link, in its joint's frame, N and N m.
    pub links: [Vector6<L>; JOINTS],
    /// Resistance of the contacts on the vehicle to its acceleration in a linearly implicit step.
    pub(super) vehicle_resistance: SpatialInertia<L>,
    /// The same of each link, in its joint's frame.
    pub(super) resistance: [SpatialInertia<L>; JOINTS],
}

impl<L: Lane> ContactScratch<L> {
    /// Zeros.
    #[inline(always)]
    pub fn new() -> Self {
        let (wrench, resistance) = (Vector6::zero(), SpatialInertia::zero());
        Self {
            places: [Place::world(); JOINTS],
            vehicle: wrench,
            links: [wrench; JOINTS],
            vehicle_resistance: resistance,
            resistance: [resistance; JOINTS],
        }
    }
}

impl<L: Lane> Default for ContactScratch<L> {
    fn default() -> Self {
        Self::new()
    }
}

impl<L: Lane> Place<L> {
    /// The world.
    #[inline(always)]
    pub fn world() -> Self {
        Self { pose: Pose::identity(), twist: Vector6::zero() }
    }

    /// Velocity and spin, world axes, of the body at a point in its frame.
    #[inline(always)]
    pub(super) fn motion_at(&self, point: Vector3<L>) -> Vector6<L> {
        let rotation = &self.pose.rotation;
        let linear = rotation.apply(self.twist.angular.cross_add(point, self.twist.linear));
        Vector6 { linear, angular: rotation.apply(self.twist.angular) }
    }

    /// A point in the world in the frame of the body, m.
    #[inline(always)]
    fn point_in_body(&self, point: Vector3<L>) -> Vector3<L> {
        self.pose.rotation.apply_transposed(point - self.pose.position)
    }

    /// Wrench in the frame of the body, of a wrench at a point of it, world axes.
    #[inline(always)]
    pub(super) fn wrench_of(&self, point: Vector3<L>, wrench: Vector6<L>) -> Vector6<L> {
        let linear = self.pose.rotation.apply_transposed(wrench.linear);
        Vector6 { linear, angular: point.cross_add(linear, self.pose.rotation.apply_transposed(wrench.angular)) }
    }
}

/// Pose of a link's joint frame in the frame of its carrier.
#[inline(always)]
fn pose_in_carrier<L: Lane, P: Param<L>, B>(joint: &JointTerms<P, B>, link: &LinkScratch<L>) -> Pose<L> {
    // By columns.
    let mut pose = Pose::identity();
    let ([o, i], [s, c]) = ([L::zero(), L::c(1.0)], link.screw);
    match joint.screw {
        JointScrew::Revolute { d } => {
            pose.rotation.0 = [[c, s, o], [-s, c, o], [o, o, i]];
            if let Some(d) = d {
                pose.position.0[2] = d.get();
            }
        }
        JointScrew::Prismatic { sin, cos } => {
            let (sin, cos) = (sin.get(), cos.get());
            pose.rotation.0 = [[cos, sin, o], [-sin, cos, o], [o, o, i]];
            pose.position.0[2] = s;
        }
    }
    joint.placement.pose_to_parent(&mut pose);
    pose.rotation = pose.rotation.transposed();
    pose
}

/// Places of the links from the place of the vehicle.
#[inline(always)]
pub(super) fn link_places<L: Lane, P: Param<L>, B>(
    system: &System<P, B>,
    is_start: bool,
    vehicle: &Place<L>,
    (q, qd): (&[L; JOINTS], &[L; JOINTS]),
    links: &mut [LinkScratch<L>],
    places: &mut [Place<L>; JOINTS],
) {
    let joints = system.chain();
    joint_screws(joints, is_start, q, links);
    for i in 0..joints.len().min(links.len()) {
        let (joint, link) = (&joints[i], &links[i]);
        let carrier = match joint.branch.carrier {
            Some(carrier) => at_carrier(carrier, Place::world(), *vehicle, &places[..i]),
            None if i == 0 => *vehicle,
            None => places[i - 1],
        };
        places[i] = Place {
            pose: carrier.pose.times(&pose_in_carrier(joint, link)),
            twist: add_joint_rate(joint, link.twist_from_parent(joint, carrier.twist), qd[i]),
        };
    }
}

/// Body of a sphere, its place, and the centre of the sphere in its frame and in the world.
#[inline(always)]
pub(super) fn sphere_at<L: Lane, P: Param<L>>(
    sphere: &SphereTerms<P>,
    vehicle: &Place<L>,
    places: &[Place<L>; JOINTS],
) -> (Place<L>, Vector3<L>, Vector3<L>) {
    let place = match sphere.body.checked_sub(1) {
        Some(k) => places[k % JOINTS],
        None => *vehicle,
    };
    let point = Vector3(get_all(&sphere.position));
    (place, point, place.pose.rotation.apply(point) + place.pose.position)
}

/// Place of a shape's body, and the pose of the shape in the world.
#[inline(always)]
pub(super) fn shape_at<L: Lane, P: Param<L>>(
    shape: &ShapeTerms<P>,
    places: &[Place<L>; JOINTS],
) -> (Place<L>, Pose<L>) {
    let pose = Pose::of(&shape.rotation, &shape.position);
    match shape.body.checked_sub(1) {
        Some(k) => (places[k % JOINTS], places[k % JOINTS].pose.times(&pose)),
        None => (Place::world(), pose),
    }
}

/// Motion of a sphere relative to a shape, in the shape's axes; and the centre in the frame of the shape's body.
#[inline(always)]
pub(super) fn relative_motion<L: Lane>(
    (sphere, point, center): &(Place<L>, Vector3<L>, Vector3<L>),
    (body, pose): &(Place<L>, Pose<L>),
) -> (RelativeMotion<L>, Vector3<L>) {
    let in_body = body.point_in_body(*center);
    let twist = sphere.motion_at(*point) - body.motion_at(in_body);
    let motion = RelativeMotion {
        center: pose.rotation.apply_transposed(*center - pose.position),
        twist: pose.rotation.apply_both_transposed(twist),
    };
    (motion, in_body)
}

/// True in some lane where a sphere is within a distance of a shape.
#[inline(always)]
pub(super) fn touches<L: Lane, P: Param<L>>(
    shape: &ShapeTerms<P>,
    sphere: &SphereTerms<P>,
    center: Vector3<L>,
    reach: L,
) -> bool {
    L::any(shape.geometry.distance(center).distance.lt(sphere.radius.get() + reach))
}

/// Wrenches of all contacts, written to the scratch memory; a routine of its own.
pub struct ContactWrenches<'a, L, P, B> {
    /// The system, with contact.
    pub system: &'a System<P, B>,
    /// True at the start of a step.
    pub is_start: bool,
    /// Size of a linearly implicit step, s. Contacts with shapes in the world act at its end, where the present rate leads. Contacts with
    /// fixtures couple two bodies, which the recursion over the tree does not: they act at its start.
    pub implicit: Option<L>,
    /// Pose of the vehicle at a start, relative to the water since the start of the step, and its motion since that start in
    /// exponential coordinates. (By reference: a copy would be a call.)
    pub pose: (&'a Pose<L>, Option<Vector6<L>>),
    /// Time since then, s.
    pub elapsed: L,
    /// Twist of the vehicle relative to the water.
    pub twist: Vector6<L>,
    /// Joint coordinates.
    pub q: &'a [L; JOINTS],
    /// Joint rates.
    pub qd: &'a [L; JOINTS],
    /// Working memory, and the wrenches.
    pub scratch: &'a mut Scratch<L>,
}

/// Pose after a motion in exponential coordinates.
#[inline(always)]
pub(super) fn moved<L: Lane>((start, theta): (&Pose<L>, Option<Vector6<L>>)) -> Pose<L> {
    match theta {
        Some(theta) => start.times(&exp_se3(theta)),
        None => *start,
    }
}

impl<L: Lane, P: Param<L>, B> Routine<L> for ContactWrenches<'_, L, P, B> {
    #[inline(always)]
    fn run(&mut self) {
        let Self { system, is_start, implicit, pose, elapsed, twist, q, qd, scratch } = self;
        let Some(ContactTerms { spheres, shapes }) = &system.contact else { return };
        let Scratch { links, contact, water, .. } = &mut **scratch;
        let vehicle = &water.place(&moved(*pose), *elapsed, *twist);
        let n = system.chain().len();
        link_places(system, *is_start, vehicle, (q, qd), &mut links[..n], &mut contact.places);
        contact.vehicle = Vector6::zero();
        for i in 0..n {
            contact.links[i] = Vector6::zero();
        }
        if implicit.is_some() {
            contact.vehicle_resistance = SpatialInertia::zero();
            for i in 0..n {
                contact.resistance[i] = SpatialInertia::zero();
            }
        }
        for shape in shapes {
            let shape_at = shape_at(shape, &contact.places);
            let step = step_at(shape, *implicit);
            let h = if let Some(h) = step { h } else { L::zero() };
            for sphere in spheres {
                let sphere_at = sphere_at(sphere, vehicle, &contact.places);
                let (motion, in_body) = relative_motion(&sphere_at, &shape_at);
                if !touches(shape, sphere, motion.center, way(&motion, h)) {
                    continue;
                }
                cold_path();
                let force = contact_force(&shape.geometry, &shape.law, sphere.radius.get(), &motion, h);
                let ((place, point, _), (body, pose)) = (sphere_at, shape_at);
                let mut wrench = force.wrench;
                if let Some(h) = step {
                    let resistance = force.resistance(&shape.law, h);
                    wrench = wrench + force.opposing(&resistance, world_acceleration(&pose, water));
                    contact.resist(sphere.body, place.resistance_of(point, &pose, &force, &resistance));
                }
                let wrench = pose.rotation.apply_both(wrench);
                contact.add(sphere.body, place.wrench_of(point, wrench));
                if shape.body > 0 {
                    contact.add(shape.body, body.wrench_of(in_body, -wrench));
                }
            }
        }
    }
}

/// A linearly implicit step, for contacts with a shape that act at its end.
#[inline(always)]
pub(super) fn step_at<P, T>(shape: &ShapeTerms<P>, implicit: Option<T>) -> Option<T> {
    if shape.body == 0 { implicit } else { None }
}

/// Way of a sphere's centre within a time `h` at most, m.
#[inline(always)]
pub(super) fn way<L: Lane>(motion: &RelativeMotion<L>, h: L) -> L {
    let v = motion.twist.linear;
    v.dot(v).sqrt() * h
}

/// Acceleration of the sphere relative to the shape, shape axes, besides the rate of its body's twist: the passes work in the frame that
/// moves with the water.
#[inline(always)]
pub(super) fn world_acceleration<L: Lane>(pose: &Pose<L>, water: &WaterFrame<L>) -> Vector6<L> {
    Vector6 { linear: pose.rotation.apply_transposed(water.acceleration), angular: Vector3::zero() }
}

impl<L: Lane> Place<L> {
    /// Resistance of a contact of the sphere about this point of the body, in the frame of the body.
    #[inline(always)]
    fn resistance_of(
        &self,
        point: Vector3<L>,
        shape: &Pose<L>,
        force: &ContactForce<L>,
        resistance: &Resistance<L>,
    ) -> SpatialInertia<L> {
        let to_body = Vector6 { linear: shape.rotation.apply(force.normal), angular: shape.rotation.apply(force.arm) };
        let Vector6 { linear: Vector3([x, y, z]), angular: arm } = self.pose.rotation.apply_both_transposed(to_body);
        let Resistance { along, across } = *resistance;
        let more = along - across;
        let mut sum = SpatialInertia::zero();
        sum.m = [
            (more * x).mul_add(x, across),
            more * x * y,
            more * x * z,
            (more * y).mul_add(y, across),
            more * y * z,
            (more * z).mul_add(z, across),
        ];
        sum.shifted(point + arm)
    }
}

impl<L: Lane> ContactScratch<L> {
    /// Adds a resistance of a body, as [`Self::add`].
    #[inline(always)]
    fn resist(&mut self, body: usize, resistance: SpatialInertia<L>) {
        match body.checked_sub(1) {
            Some(k) => self.resistance[k % JOINTS].add(&resistance),
            None => self.vehicle_resistance.add(&resistance),
        }
    }

    /// Adds a wrench on a body: 0 for the vehicle, k + 1 for the link of joint k.
    #[inline(always)]
    fn add(&mut self, body: usize, wrench: Vector6<L>) {
        let sum = match body.checked_sub(1) {
            Some(k) => &mut self.links[k % JOINTS],
            None => &mut self.vehicle,
        };
        *sum = *sum + wrench;
    }
}

const _: () = assert!(WORLD as usize > JOINTS);

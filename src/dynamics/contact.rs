//! Contact: wrenches on vehicle and links, from the places and the motion of the bodies at a stage.

use std::hint::{black_box, cold_path};

use super::aba::Scratch;
use super::branches::at_carrier;
use super::link::{LinkScratch, add_joint_rate, joint_screws};
use super::place::Place;
use crate::contact::{ContactTerms, Distance, RelativeMotion, ShapeTerms, SphereTerms, contact_force};
use crate::lane::{Lane, Param, Routine, get_all};
use crate::lie::{Pose, Vector3, Vector6, exp_se3};
use crate::system::{JOINTS, JointTerms, System, WORLD};

/// Places and motion of the bodies in the world, and the wrenches of contacts on them.
#[derive(Debug, Clone)]
pub struct ContactScratch<L> {
    /// Places of the links, each in its joint's frame.
    pub(super) places: [Place<L>; JOINTS],
    /// Wrench on the vehicle, body axes, N and N m.
    pub vehicle: Vector6<L>,
    /// Wrench on each link, in its joint's frame, N and N m.
    pub links: [Vector6<L>; JOINTS],
}

impl<L: Lane> ContactScratch<L> {
    /// Zeros.
    #[inline(always)]
    pub fn new() -> Self {
        Self { places: [black_box(Place::world()); JOINTS], vehicle: Vector6::zero(), links: [Vector6::zero(); JOINTS] }
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
    if let Some([sin, cos]) = joint.screw.theta {
        let (sin, cos) = (sin.get(), cos.get());
        pose.rotation.0 = [[cos, sin, o], [-sin, cos, o], [o, o, i]];
        pose.position.0[2] = s;
    } else {
        pose.rotation.0 = [[c, s, o], [-s, c, o], [o, o, i]];
        if let Some(d) = joint.screw.d {
            pose.position.0[2] = d.get();
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
fn moved<L: Lane>((start, theta): (&Pose<L>, Option<Vector6<L>>)) -> Pose<L> {
    match theta {
        Some(theta) => start.times(&exp_se3(theta)),
        None => *start,
    }
}

impl<L: Lane, P: Param<L>, B> Routine<L> for ContactWrenches<'_, L, P, B> {
    #[inline(always)]
    fn run(&mut self) {
        let Self { system, is_start, pose, elapsed, twist, q, qd, scratch } = self;
        let Some(ContactTerms { spheres, shapes }) = &system.contact else { return };
        let Scratch { links, contact, water, .. } = &mut **scratch;
        let vehicle = &water.place(&moved(*pose), *elapsed, *twist);
        let n = system.chain().len();
        link_places(system, *is_start, vehicle, (q, qd), &mut links[..n], &mut contact.places);
        contact.vehicle = Vector6::zero();
        for i in 0..n {
            contact.links[i] = Vector6::zero();
        }
        for shape in shapes {
            let shape_at = shape_at(shape, &contact.places);
            for sphere in spheres {
                let sphere_at = sphere_at(sphere, vehicle, &contact.places);
                let (motion, in_body) = relative_motion(&sphere_at, &shape_at);
                if !touches(shape, sphere, motion.center, L::zero()) {
                    continue;
                }
                cold_path();
                let force = contact_force(&shape.geometry, &shape.law, sphere.radius.get(), &motion);
                let ((place, point, _), (body, pose)) = (sphere_at, shape_at);
                let wrench = pose.rotation.apply_both(force.wrench);
                contact.add(sphere.body, place.wrench_of(point, wrench));
                if shape.body > 0 {
                    contact.add(shape.body, body.wrench_of(in_body, -wrench));
                }
            }
        }
    }
}

impl<L: Lane> ContactScratch<L> {
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

/// `h` times the frequency of all contacts that touch within a step of size `h` together, at most: 0 in lanes where nothing touches. The
/// rate at which friction and dissipation slow them counts with a share, as explicit methods are stable there for larger steps than
/// accurate ones of an oscillation. Spheres of a body act on the same motion: their stiffnesses and rates add up, but to no more than
/// if each had the maximum of them and all touched.
pub struct ContactRate<'a, L, P, B> {
    /// Place and motion at the start of the step.
    pub at: ContactWrenches<'a, L, P, B>,
    /// Step size, s.
    pub h: L,
    /// The result.
    pub rate: L,
}

/// Share with which rates of decay count.
const DECAY: f64 = 1.0 / 6.0;

/// Acceleration for which the reach of spheres within a step leaves room, m/s2.
const ACCELERATION: f64 = 10.0;

impl<L: Lane, P: Param<L>, B> Routine<L> for ContactRate<'_, L, P, B> {
    #[inline(always)]
    fn run(&mut self) {
        let ContactWrenches { system, pose, elapsed, twist, q, qd, scratch, .. } = &mut self.at;
        let Some(ContactTerms { spheres, shapes }) = &system.contact else { return };
        let Scratch { links, contact, water, .. } = &mut **scratch;
        let vehicle = &water.place(&moved(*pose), *elapsed, *twist);
        let n = system.chain().len();
        link_places(system, true, vehicle, (q, qd), &mut links[..n], &mut contact.places);
        let (h, zero) = (self.h, L::zero());
        // Of springs and of decay.
        let mut rates = [zero; 2];
        for shape in shapes {
            let shape_at = shape_at(shape, &contact.places);
            let (mut sum, mut most, mut of_shape) = ([zero; 2], [zero; 2], [zero; 2]);
            for sphere in spheres {
                let (motion, _) = relative_motion(&sphere_at(sphere, vehicle, &contact.places), &shape_at);
                let v = motion.twist.linear;
                let reach = (v.dot(v).sqrt() + L::c(0.5 * ACCELERATION) * h).mul_add(h, sphere.radius.get());
                let Distance { distance, normal } = shape.geometry.distance(motion.center);
                // Force and loss at the depth that the present rate reaches.
                let rate = -normal.dot(v);
                let depth = rate.max(zero).mul_add(h, sphere.radius.get() - distance);
                let force = shape.law.normal_force(depth, rate);
                let elastic = shape.law.stiffness.get() * shape.law.effective_depth(depth);
                let slip = shape.law.friction.get() * force / shape.law.slip_speed_squared.get().sqrt();
                let touches = L::select(distance.lt(reach), L::c(1.0), zero);
                let loads = [shape.law.stiffness.get(), shape.law.dissipation.get().mul_add(elastic, slip)];
                for k in 0..2 {
                    let load = touches * loads[k];
                    sum[k] = load.mul_add(sphere.mobility.get(), sum[k]);
                    most[k] = most[k].max(load * sphere.together.get());
                    of_shape[k] = load.mul_add(shape.mobility.get(), of_shape[k]);
                }
            }
            for k in 0..2 {
                rates[k] += sum[k].min(most[k]) + of_shape[k];
            }
        }
        let [square, decay] = rates;
        self.rate = h * square.sqrt().max(L::c(DECAY) * decay);
    }
}

const _: () = assert!(WORLD as usize > JOINTS);

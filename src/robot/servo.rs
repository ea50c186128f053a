//! Gains of servos and end stops by the inertia that they move, rigid and added.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3, Vector6};

use crate::description::{Arm, Body, Joint, JointServo, Parent, Vehicle, VehicleServo};

/// Natural frequency of the joints' servos, rad/s.
pub const BANDWIDTH: f64 = 3.0;
/// Natural frequency of the vehicle's servo in translation and in rotation, rad/s.
pub const STATION: [f64; 2] = [1.5, 3.0];
/// Ratio of the stiffness of end stops to the stiffness of servos.
pub const STOP: f64 = 5.0;

/// A twist: velocity of the frame's origin, and angular velocity.
#[derive(Clone, Copy)]
struct Twist(Vector3<f64>, Vector3<f64>);

impl Twist {
    /// The twist of the same motion in a frame at `p`, turned by `r`.
    fn into(self, r: &Matrix3<f64>, p: &Vector3<f64>) -> Self {
        Self(r.transpose() * (self.0 + self.1.cross(p)), r.transpose() * self.1)
    }

    /// The twist of a link's frame from its carrier's, its joint at home and at rest.
    fn beyond(self, joint: &Joint) -> Self {
        let twist = self.into(&joint.frame.rotation(), &joint.frame.position);
        let axis = joint.axis.normalize();
        if joint.slides() {
            twist.into(&Matrix3::identity(), &(axis * joint.home))
        } else {
            let turn = Rotation3::from_axis_angle(&Unit::new_unchecked(axis), joint.home);
            twist.into(turn.matrix(), &Vector3::zeros())
        }
    }

    /// Twice the kinetic energy of a body and its water.
    fn energy(self, body: &Body) -> f64 {
        let Self(v, w) = self;
        let at_com = v + w.cross(&body.center_of_mass);
        let Self(hv, hw) = self.into(&body.hydrodynamic_frame.rotation(), &body.hydrodynamic_frame.position);
        let twist = Vector6::new(hv.x, hv.y, hv.z, hw.x, hw.y, hw.z);
        body.mass * at_com.norm_squared()
            + w.dot(&(body.inertia_about_com() * w))
            + twist.dot(&(body.added_mass * twist))
    }
}

fn round(x: f64) -> f64 {
    format!("{x:.2e}").parse().expect("it was written as a number")
}

/// Sets the links' servos, and the stiffness of their end stops.
pub fn tune(arm: &mut Arm) {
    for i in 0..arm.links.len() {
        let inertia = carried(arm, i);
        let servo = JointServo { kp: round(inertia * BANDWIDTH * BANDWIDTH), kd: round(2.0 * inertia * BANDWIDTH) };
        let joint = &mut arm.links[i].joint;
        if let Some(limits) = &mut joint.limits {
            limits.stiffness = round(STOP * servo.kp);
            limits.damping = limits.stiffness;
        }
        joint.servo = Some(servo);
    }
}

/// Twice the kinetic energy of all links on those with a twist, at home.
fn energy(arm: &Arm, twists: &mut [Option<Twist>]) -> f64 {
    let mut sum = 0.0;
    for k in 0..arm.links.len() {
        if let (None, Some(Parent::Link(carrier))) = (twists[k], arm.parent(k)) {
            twists[k] = twists[carrier].map(|twist| twist.beyond(&arm.links[k].joint));
        }
        if let (Some(twist), Some(body)) = (twists[k], &arm.links[k].body) {
            sum += twist.energy(body);
        }
    }
    sum
}

/// Rigid and added inertia of all that a joint carries at home about its axis, and the inertia of its rotor, kg m2 or kg.
fn carried(arm: &Arm, i: usize) -> f64 {
    let joint = &arm.links[i].joint;
    let axis = joint.axis.normalize();
    let mut twists = vec![None; arm.links.len()];
    let zero = Vector3::zeros();
    twists[i] = Some(if joint.slides() { Twist(axis, zero) } else { Twist(zero, axis) });
    joint.rotor_inertia + energy(arm, &mut twists)
}

/// Gains of the vehicle: all that moves with it at home, per axis.
pub fn station(vehicle: &Vehicle, arm: Option<&Arm>) -> VehicleServo {
    let mut servo = VehicleServo::default();
    for i in 0..6 {
        let unit = Vector3::ith(i % 3, 1.0);
        let twist = if i < 3 { Twist(unit, Vector3::zeros()) } else { Twist(Vector3::zeros(), unit) };
        let mut inertia = twist.energy(&vehicle.body);
        if let Some(arm) = arm {
            let mount = twist.into(&arm.mount.frame.rotation(), &arm.mount.frame.position);
            inertia += arm.base.as_ref().map_or(0.0, |base| mount.energy(base));
            let on = |k| match arm.parent(k) {
                Some(Parent::Vehicle) => Some(twist.beyond(&arm.links[k].joint)),
                Some(Parent::Base) => Some(mount.beyond(&arm.links[k].joint)),
                _ => None,
            };
            let mut twists: Vec<_> = (0..arm.links.len()).map(on).collect();
            inertia += energy(arm, &mut twists);
        }
        let bandwidth = STATION[i / 3];
        (servo.kp[i], servo.kd[i]) = (round(inertia * bandwidth * bandwidth), round(2.0 * inertia * bandwidth));
    }
    servo
}

//! Gains of servos and end stops by the inertia that they move, rigid and added, and by its weight in water.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3, Vector6};

use crate::description::{Arm, Body, Joint, JointServo, Parent, Vehicle, VehicleServo};

/// Minimum natural frequency of the joints' servos, rad/s.
pub const BANDWIDTH: f64 = 3.0;
/// Maximum deflection of a joint under the weight in water of all that it carries at home, in any attitude: rad, and m of a slide.
pub const SAG: [f64; 2] = [0.02, 0.002];
/// Gravity, m/s2.
const GRAVITY: f64 = 9.81;
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

    /// Velocity of a point.
    fn at(self, point: &Vector3<f64>) -> Vector3<f64> {
        self.0 + self.1.cross(point)
    }

    /// Twice the kinetic energy of a body and its water.
    fn energy(self, body: &Body) -> f64 {
        let w = self.1;
        let Self(hv, hw) = self.into(&body.hydrodynamic_frame.rotation(), &body.hydrodynamic_frame.position);
        let twist = Vector6::new(hv.x, hv.y, hv.z, hw.x, hw.y, hw.z);
        body.mass * self.at(&body.center_of_mass).norm_squared()
            + w.dot(&(body.inertia_about_com() * w))
            + twist.dot(&(body.added_mass * twist))
    }
}

fn round(x: f64) -> f64 {
    format!("{x:.2e}").parse().expect("it was written as a number")
}

/// Sets the links' servos, and the stiffness of their end stops, in water of this density.
pub fn tune(arm: &mut Arm, density: f64) {
    let moment = |twist: Twist, body: &Body| {
        let buoyancy = density * body.volume.unwrap_or(0.0) * twist.at(&body.center_of_buoyancy);
        GRAVITY * (body.mass * twist.at(&body.center_of_mass) - buoyancy).norm()
    };
    for i in 0..arm.links.len() {
        let inertia = arm.links[i].joint.rotor_inertia + carried(arm, i, &Twist::energy);
        let load = carried(arm, i, &moment);
        let joint = &mut arm.links[i].joint;
        let kp = (inertia * BANDWIDTH * BANDWIDTH).max(load / SAG[usize::from(joint.slides())]);
        let servo = JointServo { kp: round(kp), kd: round(2.0 * (inertia * kp).sqrt()) };
        if let Some(limits) = &mut joint.limits {
            limits.stiffness = round(STOP * servo.kp);
            limits.damping = limits.stiffness;
        }
        joint.servo = Some(servo);
    }
}

/// Sum over all links on those with a twist, at home.
fn sum(arm: &Arm, twists: &mut [Option<Twist>], of: &dyn Fn(Twist, &Body) -> f64) -> f64 {
    let mut sum = 0.0;
    for k in 0..arm.links.len() {
        if let (None, Some(Parent::Link(carrier))) = (twists[k], arm.parent(k)) {
            twists[k] = twists[carrier].map(|twist| twist.beyond(&arm.links[k].joint));
        }
        if let (Some(twist), Some(body)) = (twists[k], &arm.links[k].body) {
            sum += of(twist, body);
        }
    }
    sum
}

/// Sum over all links that a joint carries, which turn about its axis or slide along it at unit speed.
fn carried(arm: &Arm, i: usize, of: &dyn Fn(Twist, &Body) -> f64) -> f64 {
    let joint = &arm.links[i].joint;
    let axis = joint.axis.normalize();
    let mut twists = vec![None; arm.links.len()];
    let zero = Vector3::zeros();
    twists[i] = Some(if joint.slides() { Twist(axis, zero) } else { Twist(zero, axis) });
    sum(arm, &mut twists, of)
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
            inertia += sum(arm, &mut twists, &Twist::energy);
        }
        let bandwidth = STATION[i / 3];
        (servo.kp[i], servo.kd[i]) = (round(inertia * bandwidth * bandwidth), round(2.0 * inertia * bandwidth));
    }
    servo
}

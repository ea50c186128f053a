//! Contact where a run starts: joints at home, and the vehicle at the origin unless a task places it elsewhere.

use nalgebra::{Isometry3, Point3, UnitQuaternion};

use super::warnings::implausible;
use super::{Body, ContactShape, Frame, Joint, JointKind, Parent, Scene, SceneWarning, Sphere};

/// Step times the natural frequency of contact, beyond which `mk4` is unstable.
const STABLE: f64 = 2.8;

fn pose(frame: &Frame) -> Isometry3<f64> {
    let rpy = frame.rpy;
    Isometry3::from_parts(frame.position.into(), UnitQuaternion::from_euler_angles(rpy.x, rpy.y, rpy.z))
}

/// Pose in its parent's frame of the body that a joint at home carries.
fn at_home(joint: &Joint) -> Isometry3<f64> {
    let way = joint.axis * joint.home;
    let motion = match joint.kind {
        JointKind::Revolute => Isometry3::rotation(way),
        JointKind::Prismatic => Isometry3::from(way),
        JointKind::Fixed => Isometry3::identity(),
    };
    pose(&joint.frame) * motion
}

impl Scene {
    /// Body of the robot that carries a sphere.
    fn carrier(&self, sphere: &Sphere) -> Parent {
        let body = self.arm.as_ref().and_then(|arm| arm.body(&sphere.on, arm.links.len()));
        body.unwrap_or(Parent::Vehicle)
    }

    /// Pose of a body of the robot in the vehicle's frame, joints at home.
    fn home_pose(&self, body: Parent) -> Isometry3<f64> {
        match (body, &self.arm) {
            (Parent::Vehicle, _) | (_, None) => Isometry3::identity(),
            (Parent::Base, Some(arm)) => {
                pose(&arm.mount.frame) * arm.mount.joint.as_ref().map_or_else(Isometry3::identity, at_home)
            }
            (Parent::Link(i), Some(arm)) => {
                self.home_pose(arm.parent(i).unwrap_or(Parent::Base)) * at_home(&arm.links[i].joint)
            }
        }
    }

    /// Pose of a shape in the world, fixtures at home.
    fn shape_pose(&self, shape: &ContactShape) -> Isometry3<f64> {
        let fixture = self.fixtures.iter().find(|fixture| fixture.name == shape.on);
        fixture.map_or_else(Isometry3::identity, |fixture| at_home(&fixture.joint)) * pose(&shape.frame)
    }

    /// Rigid body of the robot.
    fn robot_body(&self, body: Parent) -> Option<&Body> {
        match (body, &self.arm) {
            (Parent::Vehicle, _) | (_, None) => (!self.vehicle.fixed).then_some(&self.vehicle.body),
            (Parent::Base, Some(arm)) => arm.base.as_ref().filter(|_| arm.mount.joint.is_some()),
            (Parent::Link(i), Some(arm)) => arm.links[i].body.as_ref().filter(|_| arm.links[i].moves()),
        }
    }

    /// Spheres inside shapes at the start, and contact too stiff for the step.
    pub(super) fn lint_contact(&self, warnings: &mut Vec<SceneWarning>) {
        let Some(contact) = &self.contact else { return };
        let step = self.integration().step;
        let shapes: Vec<_> = contact.shapes.iter().map(|shape| (shape, self.shape_pose(shape).inverse())).collect();
        for (i, sphere) in contact.spheres.iter().enumerate() {
            let key = format!("contact.spheres[{i}] ({})", sphere.name);
            let body = self.carrier(sphere);
            let center = self.home_pose(body) * Point3::from(sphere.position);
            for (shape, pose) in &shapes {
                let depth = -shape.geometry.distance(&(pose * center).coords);
                if depth > 0.0 {
                    let name = &shape.name;
                    let text = format!(
                        "its centre is {depth:.4} m inside the shape '{name}', vehicle at the origin, joints at home"
                    );
                    warnings.push(implausible(key.clone(), text));
                }
            }
            let stiffest = contact.shapes.iter().map(|shape| contact.law(shape).stiffness).fold(0.0, f64::max);
            let Some(body) = self.robot_body(body) else { continue };
            let mass = body.mass + (0..3).map(|k| body.added_mass[(k, k)]).fold(f64::INFINITY, f64::min);
            let maximum = STABLE * (mass / stiffest).sqrt();
            if step > maximum {
                let text = format!(
                    "{stiffest} N/m on the {mass:.3} kg of '{}' need a step below {:.2} ms, but the step is {:.2} ms",
                    sphere.on,
                    1e3 * maximum,
                    1e3 * step
                );
                warnings.push(implausible(key, text));
            }
        }
    }
}

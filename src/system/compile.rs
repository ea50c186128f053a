//! Compilation of a scene to the constants of the kernel.

use super::bodies::{Part, merged};
use super::factors::UnscaledBodyTerms;
use super::joint_frames::{Line, inverse, joint_frames, nonzero, pose, tidy, vector};
use super::model::{Actuator, Friction, JointScrew, JointTerms, Limits, Servo, System, VehicleServo};
use super::propulsion::thrusters;
use crate::description::{Joint, JointKind, LinearActuator, Scene, Vehicle};
use crate::lane::Shared;
use crate::lie::Pose;

/// A compiled scene: the system, and the link frames of the scene in the joint frames of the system.
#[derive(Debug, Clone)]
pub struct Compiled {
    /// Constants of the kernel.
    pub system: System<Shared<f64>>,
    /// Constant pose of each link's frame in its joint's frame.
    pub links: Vec<Pose<f64>>,
    /// Attachment of payloads: the end effector's origin in the last moving body's frame, m.
    pub payload_attachment: [f64; 3],
    /// Parts of the terms of each moving body, vehicle first.
    pub unscaled: Vec<UnscaledBodyTerms<Shared<f64>>>,
}

/// Compiles a checked scene: merges bodies that are fixed together, chooses joint frames, drops absent terms.
pub fn compile(scene: &Scene) -> Compiled {
    let water = &scene.water;
    let mut parts = vec![Part::of(&scene.vehicle.body, Pose::identity(), water)];
    let mut vehicle = parts.split_off(0);
    let mut moving: Vec<(&Joint, Vec<Part>)> = Vec::new();
    // Poses at q = 0, in the vehicle frame, of the moving links' frames, and of the frame that carries the next part.
    let mut zero_poses: Vec<Pose<f64>> = Vec::new();
    let mut parent = Pose::identity();
    let mut tip = Pose::identity();

    if let Some(arm) = &scene.arm {
        parent = pose(&arm.mount.frame);
        if let Some(joint) = &arm.mount.joint {
            parent = parent.times(&pose(&joint.frame));
            zero_poses.push(parent);
            let base = arm.base.iter().map(|body| Part::of(body, Pose::identity(), water)).collect();
            moving.push((joint, base));
        } else {
            vehicle.extend(arm.base.iter().map(|body| Part::of(body, parent, water)));
        }
        for link in &arm.links {
            parent = parent.times(&pose(&link.joint.frame));
            zero_poses.push(parent);
            moving.push((&link.joint, vec![Part::of(&link.body, Pose::identity(), water)]));
        }
        tip = pose(&arm.end_effector);
    }
    if let Some(payload) = &scene.payload {
        let at = tip.times(&pose(&payload.frame));
        match moving.last_mut() {
            Some((_, last)) => last.push(Part::of(&payload.body, at, water)),
            None => vehicle.push(Part::of(&payload.body, parent.times(&at), water)),
        }
    }

    let lines: Vec<Line> = moving
        .iter()
        .zip(&zero_poses)
        .map(|((joint, _), link)| Line {
            point: link.position,
            direction: link.rotation.apply(vector(&joint.axis)),
            axes: link.rotation,
        })
        .collect();
    let frames = joint_frames(&lines);
    let links: Vec<Pose<f64>> =
        frames.iter().zip(&zero_poses).map(|(frame, link)| tidy(&inverse(&frame.pose).times(link))).collect();

    let (vehicle, of_vehicle) = merged(&vehicle, &Pose::identity());
    let mut unscaled = vec![of_vehicle.map(Shared)];
    let joints: Vec<JointTerms<f64>> = moving
        .iter()
        .zip(&frames)
        .zip(&links)
        .map(|(((joint, parts), frame), link)| {
            let prismatic = joint.kind == JointKind::Prismatic;
            let (body, of_body) = merged(parts, link);
            unscaled.push(of_body.map(Shared));
            JointTerms {
                placement: frame.placement,
                offset: if prismatic { frame.d } else { frame.theta },
                screw: if prismatic {
                    let (sin, cos) = frame.theta.sin_cos();
                    JointScrew::Prismatic { sin, cos }
                } else {
                    JointScrew::Revolute { d: nonzero(frame.d) }
                },
                body,
                rotor_inertia: (joint.prescribed || joint.rotor_inertia != 0.0).then_some(joint.rotor_inertia),
                prescribed: joint.prescribed,
                friction: friction(joint),
                limits: limits(joint),
                servo: servo(joint),
                effort: joint.effort,
                actuator: joint.actuator.as_ref().map(actuator),
            }
        })
        .collect();
    let sparse =
        unscaled.iter().all(|of| [&of.rigid, &of.added].iter().all(|part| part.map(|Shared(x)| x).is_sparse()));
    let system = System {
        sparse,
        prescribed: joints.iter().any(|joint| joint.prescribed),
        z_aligned: joints.iter().all(|joint| joint.body.is_z_aligned()),
        gravity: water.gravity.into(),
        fixed: scene.vehicle.fixed,
        vehicle,
        joints,
        vehicle_servo: vehicle_servo(&scene.vehicle),
        thrusters: thrusters(&scene.vehicle),
        terms: scene.vehicle.terms(water),
    };
    let payload_attachment = tidy(&links.last().unwrap_or(&parent).times(&tip)).position.0;
    Compiled { system: system.map(Shared), links, payload_attachment, unscaled }
}

fn friction(joint: &Joint) -> Option<Friction<f64>> {
    let f = &joint.friction;
    let coulomb = (f.coulomb != 0.0).then_some([f.coulomb, f.coulomb_speed * f.coulomb_speed]);
    (f.viscous != 0.0 || coulomb.is_some()).then_some(Friction { viscous: f.viscous, coulomb })
}

fn servo(joint: &Joint) -> Option<Servo<f64>> {
    let gains = joint.servo.as_ref().filter(|s| s.kp != 0.0 || s.kd != 0.0)?;
    Some(Servo { kp: gains.kp, kd: gains.kd })
}

fn actuator(given: &LinearActuator) -> Actuator<f64> {
    let (a, b) = (given.base, given.lever);
    Actuator { angle: given.angle, stroke: [a * a + b * b, 2.0 * a * b], force: given.force * a * b }
}

fn vehicle_servo(vehicle: &Vehicle) -> Option<VehicleServo<f64>> {
    let gains = vehicle.servo.as_ref().filter(|s| s.kp.iter().chain(&s.kd).any(|&gain| gain != 0.0))?;
    Some(VehicleServo { kp: gains.kp, kd: gains.kd })
}

/// End stops, unless stiffness and damping are 0.
fn limits(joint: &Joint) -> Option<Limits<f64>> {
    let limits = joint.limits.as_ref().filter(|l| l.stiffness != 0.0 || l.damping != 0.0)?;
    Some(Limits { range: [limits.lower, limits.upper], stop: [limits.stiffness, limits.damping] })
}

//! Compilation of a scene to the constants of the kernel.

use super::bodies::{Part, merged};
use super::factors::UnscaledBodyTerms;
use super::joint_frames::{Line, inverse, joint_frames, nonzero, pose, tidy, vector};
use super::model::{Actuator, Branch, Friction, JointScrew, JointTerms, Limits, Servo, System, VehicleServo};
use super::propulsion::thrusters;
use crate::description::{Joint, JointKind, LinearActuator, Parent, Scene, Vehicle};
use crate::lane::Shared;
use crate::lie::Pose;

/// A compiled scene: the system, and the link frames of the scene in the joint frames of the system.
#[derive(Debug, Clone)]
pub struct Compiled {
    /// Constants of the kernel.
    pub system: System<Shared<f64>>,
    /// Constant pose of each link's frame in its joint's frame.
    pub links: Vec<Pose<f64>>,
    /// Attachment of payloads: the end effector's origin in the frame of its moving body, m.
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
    // Of the moving links: poses of their frames at q = 0, in the vehicle frame, and the joints that carry them, if any.
    let mut zero_poses: Vec<Pose<f64>> = Vec::new();
    let mut carriers: Vec<Option<usize>> = Vec::new();
    // Frame and carrier of the end effector.
    let (mut tip, mut tip_carrier) = (Pose::identity(), None);

    if let Some(arm) = &scene.arm {
        let mut base = pose(&arm.mount.frame);
        let first = usize::from(arm.mount.joint.is_some());
        if let Some(joint) = &arm.mount.joint {
            base = base.times(&pose(&joint.frame));
            zero_poses.push(base);
            carriers.push(None);
            let part = arm.base.iter().map(|body| Part::of(body, Pose::identity(), water)).collect();
            moving.push((joint, part));
        } else {
            vehicle.extend(arm.base.iter().map(|body| Part::of(body, base, water)));
        }
        // Frame of a body in the vehicle frame at q = 0, and its joint.
        let body = |of: Option<Parent>, links: &[Pose<f64>]| match of {
            Some(Parent::Link(k)) => (links[first + k], Some(first + k)),
            Some(Parent::Vehicle) => (Pose::identity(), None),
            Some(Parent::Base) | None => (base, first.checked_sub(1)),
        };
        for (i, link) in arm.links.iter().enumerate() {
            let (parent, carrier) = body(arm.parent(i), &zero_poses);
            zero_poses.push(parent.times(&pose(&link.joint.frame)));
            carriers.push(carrier);
            moving.push((&link.joint, vec![Part::of(&link.body, Pose::identity(), water)]));
        }
        let (frame, carrier) = body(arm.tip(), &zero_poses);
        (tip, tip_carrier) = (pose(&arm.end_effector), carrier);
        if carrier.is_none() {
            tip = frame.times(&tip);
        }
    }
    if let Some(payload) = &scene.payload {
        let parts = tip_carrier.map_or(&mut vehicle, |k| &mut moving[k].1);
        parts.push(Part::of(&payload.body, tip.times(&pose(&payload.frame)), water));
    }

    let lines: Vec<Line> = moving
        .iter()
        .zip(&zero_poses)
        .zip(&carriers)
        .map(|(((joint, _), link), carrier)| Line {
            carrier: *carrier,
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
        .enumerate()
        .map(|(i, (((joint, parts), frame), link))| {
            let prismatic = joint.kind == JointKind::Prismatic;
            let (body, of_body) = merged(parts, link);
            unscaled.push(of_body.map(Shared));
            let before = carriers[i] == i.checked_sub(1);
            let branches = (0..carriers.len()).any(|k| k != i + 1 && carriers[k] == Some(i));
            JointTerms {
                branch: Branch {
                    carrier: (!before).then(|| carriers[i].map_or(0, |k| k as u8 + 1)),
                    forks: branches || (tip_carrier == Some(i) && i + 1 < carriers.len()),
                },
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
        tree: joints.iter().any(|joint| joint.branch.carrier.is_some()),
        payload_body: tip_carrier.map_or(0, |k| k + 1),
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
    let payload_attachment = tidy(&tip_carrier.map_or(tip, |k| links[k].times(&tip))).position.0;
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

//! Compilation of a scene to the constants of the kernel.

use std::f64::consts::TAU;

use super::bodies::{Part, merged};
use super::contact::contact_terms;
use super::factors::UnscaledBodyTerms;
use super::joint_frames::{Line, inverse, joint_frames, nonzero, placed, pose, tidy, vector};
use super::model::{
    Actuator, Branch, BreakAway, Detent, Friction, JointKind, JointScrew, JointTerms, Limits, RareTerms, Servo, System,
    VehicleServo, WORLD,
};
use super::propulsion::thrusters;
use crate::description::{EndEffectorFrame, Joint, LinearActuator, Parent, Scene, Vehicle};
use crate::lane::Shared;
use crate::lie::Pose;

/// A compiled scene: the system, and the link frames of the scene in the joint frames of the system.
#[derive(Debug, Clone)]
pub struct Compiled {
    /// Constants of the kernel.
    pub system: System<Shared<f64>>,
    /// Constant pose of each link's frame in its joint's frame.
    pub links: Vec<Pose<f64>>,
    /// Frames of the arm's base and of all links, each in the joint frame of its moving body or in the vehicle frame, with the
    /// number of that body, 0 for the vehicle.
    pub frames: Vec<(usize, Pose<f64>)>,
    /// The end effector in the joint frame of its moving body, or in the vehicle frame.
    pub tip: Pose<f64>,
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
    // Of the arm's base and the links.
    let mut places: Vec<Place> = Vec::new();
    let (mut tip, mut exact_tip, mut grip) = (Place::default(), Pose::identity(), Place::default());

    if let Some(arm) = &scene.arm {
        let mount = pose(&arm.mount.frame);
        let base = match &arm.mount.joint {
            Some(joint) => {
                zero_poses.push(mount.times(&pose(&joint.frame)));
                carriers.push(None);
                let part = arm.base.iter().map(|body| Part::of(body, Pose::identity(), water)).collect();
                moving.push((joint, part));
                Place { joint: Some(0), frame: None }
            }
            None => {
                vehicle.extend(arm.base.iter().map(|body| Part::of(body, mount, water)));
                Place { joint: None, frame: Some(mount) }
            }
        };
        places.push(base);
        let place = |of: Option<Parent>, places: &[Place]| match of {
            Some(Parent::Link(k)) => places[1 + k],
            Some(Parent::Vehicle) => Place::default(),
            Some(Parent::Base) | None => base,
        };
        for (i, link) in arm.links.iter().enumerate() {
            let parent = place(arm.parent(i), &places);
            let frame = pose(&link.joint.frame);
            if link.moves() {
                zero_poses.push(match parent.joint {
                    Some(k) => zero_poses[k].times(&parent.of(frame)),
                    None => parent.of(frame),
                });
                carriers.push(parent.joint);
                places.push(Place { joint: Some(moving.len()), frame: None });
                let part = link.body.iter().map(|body| Part::of(body, Pose::identity(), water)).collect();
                moving.push((&link.joint, part));
            } else {
                let at = parent.of(frame);
                places.push(Place { joint: parent.joint, frame: Some(at) });
                let parts = parent.joint.map_or(&mut vehicle, |k| &mut moving[k].1);
                parts.extend(link.body.iter().map(|body| Part::of(body, at, water)));
            }
        }
        let end = |of: &EndEffectorFrame| {
            let carrier = place(arm.carrier(of), &places);
            Place { joint: carrier.joint, frame: Some(carrier.of(pose(&of.frame()))) }
        };
        exact_tip = place(arm.carrier(&arm.end_effector), &places).of(placed(&arm.end_effector.frame()));
        tip = end(&arm.end_effector);
        grip = scene.payload.as_ref().map_or(tip, |payload| end(arm.payload_end_effector(payload)));
    }
    let (tip, tip_carrier) = (tip.frame.unwrap_or_else(Pose::identity), tip.joint);
    if let Some(payload) = &scene.payload {
        let parts = grip.joint.map_or(&mut vehicle, |k| &mut moving[k].1);
        parts.push(Part::of(&payload.body, grip.of(pose(&payload.frame)), water));
    }

    // Fixtures: their frames at q = 0 are in the world.
    let robot = moving.len();
    for fixture in &scene.fixtures {
        zero_poses.push(pose(&fixture.joint.frame));
        carriers.push(None);
        let part = fixture.body.iter().map(|body| Part::of(body, Pose::identity(), water)).collect();
        moving.push((&fixture.joint, part));
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
            let prismatic = joint.slides();
            let (body, of_body) = merged(parts, link);
            unscaled.push(of_body.map(Shared));
            let before = carriers[i] == i.checked_sub(1) && i < robot;
            let branches = (0..carriers.len()).any(|k| k != i + 1 && carriers[k] == Some(i));
            let joint = JointTerms {
                kind: JointKind::Other,
                branch: Branch {
                    carrier: if i >= robot {
                        Some(WORLD)
                    } else {
                        (!before).then(|| carriers[i].map_or(0, |k| k as u8 + 1))
                    },
                    forks: branches || (tip_carrier == Some(i) && i + 1 < carriers.len()),
                },
                placement: frame.placement,
                offset: if prismatic { frame.d } else { frame.theta },
                screw: if prismatic {
                    JointScrew { d: None, theta: Some(frame.theta.sin_cos().into()) }
                } else {
                    JointScrew { d: nonzero(frame.d), theta: None }
                },
                body,
                rotor_inertia: (joint.prescribed || joint.rotor_inertia != 0.0).then_some(joint.rotor_inertia),
                prescribed: joint.prescribed,
                friction: friction(joint),
                limits: limits(joint),
                servo: servo(joint),
                effort: joint.effort,
                rare: rare_terms(joint).map(Box::new),
            };
            JointTerms { kind: joint.kind(), ..joint }
        })
        .collect();
    let in_joint = |place: &Place| match (place.joint, place.frame) {
        (Some(k), None) => (k + 1, links[k]),
        (Some(k), Some(frame)) => (k + 1, links[k].times(&frame)),
        (None, frame) => (0, frame.unwrap_or_else(Pose::identity)),
    };
    let robot_body = |name: &str| match scene.arm.as_ref().and_then(|arm| arm.named(name)) {
        Some(Parent::Base) => in_joint(&places[0]),
        Some(Parent::Link(k)) => in_joint(&places[1 + k]),
        Some(Parent::Vehicle) | None => (0, Pose::identity()),
    };
    let fixture = |name: &str| match scene.fixtures.iter().position(|fixture| fixture.name == name) {
        Some(k) => (robot + k + 1, links[robot + k]),
        None => (0, Pose::identity()),
    };
    let contact = contact_terms(scene, &vehicle, &joints, robot_body, fixture);
    let sparse =
        unscaled.iter().all(|of| [&of.rigid, &of.added].iter().all(|part| part.map(|Shared(x)| x).is_sparse()));
    let system = System {
        sparse,
        tree: joints.iter().any(|joint| joint.branch.carrier.is_some()),
        payload_body: tip_carrier.map_or(0, |k| k + 1),
        prescribed: joints.iter().any(|joint| joint.prescribed),
        geared: joints.iter().any(|joint| joint.rotor_inertia.is_some()),
        z_aligned: joints.iter().all(|joint| joint.body.is_z_aligned()),
        gravity: water.gravity.into(),
        fixed: scene.vehicle.fixed,
        vehicle,
        joints,
        vehicle_servo: vehicle_servo(&scene.vehicle),
        thrusters: thrusters(&scene.vehicle),
        terms: scene.vehicle.terms(water),
        contact,
    };
    let payload_attachment = tidy(&tip_carrier.map_or(tip, |k| links[k].times(&tip))).position.0;
    let tip = tip_carrier.map_or(exact_tip, |k| links[k].times(&exact_tip));
    let frames = places.iter().map(in_joint).collect();
    Compiled { system: system.map(Shared), links, frames, tip, payload_attachment, unscaled }
}

/// Place of a body in the tree of moving bodies.
#[derive(Debug, Clone, Copy, Default)]
struct Place {
    /// Joint that moves it; none where it is part of the vehicle.
    joint: Option<usize>,
    /// Its frame in the frame of that joint's link, or of the vehicle; absent where they are the same.
    frame: Option<Pose<f64>>,
}

impl Place {
    /// A pose in this body, seen from the moving body.
    fn of(&self, pose: Pose<f64>) -> Pose<f64> {
        self.frame.map_or(pose, |frame| frame.times(&pose))
    }
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

fn rare_terms(joint: &Joint) -> Option<RareTerms<f64>> {
    let excess = joint.friction.at_rest() - joint.friction.coulomb;
    let break_away = joint.friction.stribeck_speed.filter(|_| excess != 0.0).map(|speed| BreakAway {
        excess,
        decay: 1.0 / (speed * speed),
        speed_squared: joint.friction.coulomb_speed * joint.friction.coulomb_speed,
    });
    let spring = joint.spring.as_ref().filter(|spring| spring.stiffness != 0.0);
    let detent = joint.detent.as_ref().filter(|detent| detent.torque != 0.0);
    let terms = RareTerms {
        actuator: joint.actuator.as_ref().map(actuator),
        spring: spring.map(|spring| [spring.stiffness, spring.rest]),
        detent: detent.map(|detent| Detent { torque: detent.torque, rate: TAU / detent.period, offset: detent.offset }),
        break_away,
    };
    (terms != RareTerms::default()).then_some(terms)
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

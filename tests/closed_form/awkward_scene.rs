//! One scene with everything that can go wrong in it: offsets, tilted frames, full matrices, both kinds of joint.

use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3, Vector6};
use uvms_gym::description::{
    Arm, Body, Damping, Frame, Friction, InertiaPoint, Joint, JointKind, JointLimits, Link, Mount, Payload, Provenance,
    Scene, Thruster, Vehicle, Water,
};
use uvms_gym::system::State;

/// Whether the arm's base is screwed on or turns on a joint q0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loading {
    Fixed,
    Joint,
}

/// A current to test in, world axes.
pub fn current() -> Vector3<f64> {
    Vector3::new(0.4, -0.7, 0.2)
}

pub const LOADINGS: [Loading; 2] = [Loading::Fixed, Loading::Joint];

pub fn scene(loading: Loading) -> Scene {
    Scene {
        name: "awkward".into(),
        summary: String::new(),
        water: Water { density: 1025.0, gravity: Vector3::new(0.3, -0.2, -9.7), current: Vector3::zeros() },
        vehicle: Vehicle {
            name: "vehicle".into(),
            fixed: false,
            body: body(0.1, 30.0),
            thrusters: vec![
                thruster(Vector3::new(0.3, 0.1, -0.1), Vector3::new(0.6, 0.8, 0.0)),
                thruster(Vector3::new(-0.2, 0.2, 0.1), Vector3::new(0.0, -0.6, 0.8)),
            ],
            servo: None,
        },
        arm: Some(arm(loading)),
        payload: Some(Payload { frame: frame(0.7), body: body(5.0, 1.5) }),
        provenance: Provenance::default(),
    }
}

fn arm(loading: Loading) -> Arm {
    let link =
        |seed: f64, kind, mass| Link { name: format!("{seed}"), joint: joint(seed, kind), body: body(seed, mass) };
    Arm {
        name: "arm".into(),
        mount: Mount { frame: frame(1.0), joint: (loading == Loading::Joint).then(|| joint(6.0, JointKind::Revolute)) },
        base: Some(body(1.3, 2.0)),
        links: vec![
            link(2.0, JointKind::Revolute, 3.0),
            link(3.0, JointKind::Prismatic, 2.5),
            link(4.0, JointKind::Revolute, 1.0),
        ],
        end_effector: frame(0.4),
    }
}

/// Numbers in [-1, 1] that repeat nowhere nearby.
fn number(seed: f64, i: usize) -> f64 {
    (12.9 * seed + 7.7 * i as f64 + 0.3).sin()
}

pub fn vector(seed: f64) -> Vector3<f64> {
    Vector3::from_fn(|i, _| number(seed, i))
}

pub fn vector6(seed: f64) -> Vector6<f64> {
    Vector6::from_fn(|i, _| number(seed, i))
}

pub fn frame(seed: f64) -> Frame {
    Frame { position: 0.4 * vector(seed), rpy: 1.5 * vector(seed + 0.5) }
}

/// A symmetric positive definite matrix of about the given size.
pub fn definite6(seed: f64, size: f64) -> Matrix6<f64> {
    let root = Matrix6::from_fn(|i, j| number(seed, 6 * i + j));
    (root * root.transpose() * 0.2 + Matrix6::identity() * 0.2) * size
}

pub fn body(seed: f64, mass: f64) -> Body {
    let turn = Rotation3::new(vector(seed + 0.2));
    let moments = Matrix3::from_diagonal(&Vector3::new(0.03, 0.04, 0.06)) * mass;
    Body {
        mass,
        center_of_mass: 0.1 * vector(seed),
        inertia: turn * moments * turn.transpose(),
        inertia_at: InertiaPoint::Com,
        weight: None,
        volume: Some(1.1e-3 * mass),
        buoyancy: None,
        center_of_buoyancy: 0.2 * vector(seed + 0.4),
        hydrodynamic_frame: frame(seed + 0.6),
        added_mass: definite6(seed + 0.1, mass),
        damping: Damping {
            linear: definite6(seed + 0.7, 3.0),
            quadratic: Matrix6::from_diagonal(&Vector6::from_fn(|i, _| 4.0 + number(seed, i))),
        },
    }
}

pub fn joint(seed: f64, kind: JointKind) -> Joint {
    Joint {
        kind,
        frame: frame(seed),
        axis: vector(seed + 0.9).normalize(),
        friction: Friction { viscous: 0.5, coulomb: 0.2, coulomb_speed: 0.05 },
        limits: Some(JointLimits { lower: -0.5, upper: 0.4, stiffness: 40.0, damping: 3.0 }),
        effort: None,
        speed: None,
        servo: None,
        home: 0.0,
    }
}

fn thruster(position: Vector3<f64>, axis: Vector3<f64>) -> Thruster {
    Thruster { name: String::new(), position, axis, limits: [-40.0, 50.0] }
}

/// The scene without water and gravity.
pub fn dry(scene: &Scene) -> Scene {
    let mut dry = scene.clone();
    dry.water.density = 0.0;
    dry.water.gravity = Vector3::zeros();
    for_bodies(&mut dry, |body| {
        body.added_mass = Matrix6::zeros();
        body.damping = Damping::default();
    });
    dry
}

/// The scene without drag and gravity, its joints without friction and end stops.
pub fn lossless(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    scene.water.gravity = Vector3::zeros();
    for_bodies(&mut scene, |body| body.damping = Damping::default());
    for_joints(&mut scene, |joint| {
        joint.friction = Friction::default();
        joint.limits = None;
    });
    scene
}

fn for_bodies(scene: &mut Scene, change: impl Fn(&mut Body)) {
    change(&mut scene.vehicle.body);
    if let Some(arm) = &mut scene.arm {
        arm.base.iter_mut().for_each(&change);
        arm.links.iter_mut().for_each(|link| change(&mut link.body));
    }
    scene.payload.iter_mut().for_each(|payload| change(&mut payload.body));
}

pub fn for_joints(scene: &mut Scene, change: impl Fn(&mut Joint)) {
    if let Some(arm) = &mut scene.arm {
        arm.mount.joint.iter_mut().for_each(&change);
        arm.links.iter_mut().for_each(|link| change(&mut link.joint));
    }
}

/// A state in full motion, some joints beyond their limits.
pub fn state(scene: &Scene, seed: f64) -> State {
    let mut state = State {
        position: 2.0 * vector(seed),
        rotation: Rotation3::new(1.4 * vector(seed + 0.3)).into_inner(),
        twist: vector6(seed + 0.6),
        ..State::default()
    };
    for i in 0..scene.joints().count() {
        state.q[i] = number(seed + 0.1, i);
        state.qd[i] = number(seed + 0.2, i);
    }
    state
}

//! Scenes, states and loads to try the closed form on.

use nalgebra::{DVector, Matrix6, Vector3, Vector6};
use uvms_gym::description::{Body, Damping, Friction, Scene};
use uvms_gym::dynamics::Loads;
use uvms_gym::system::State;

use crate::random_scene::{Options, Random, random_scene};

/// Random scenes on a free vehicle, every third without links, all with a payload, by fixed and by joint loading.
pub fn scenes() -> impl Iterator<Item = (u64, Scene)> {
    (0..12_u64).map(|seed| {
        let options = Options {
            links: seed.is_multiple_of(3).then_some(0),
            fixed: Some(false),
            joint_loading: Some(seed % 2 == 1),
            payload: Some(true),
            joint_forces: Some(true),
            ..Options::default()
        };
        (seed, random_scene(seed, options))
    })
}

/// One random scene on a free vehicle: an arm base, three links and a payload, without friction and end stops.
pub fn scene(joint_loading: bool) -> Scene {
    let options = Options {
        links: Some(3),
        fixed: Some(false),
        joint_loading: Some(joint_loading),
        payload: Some(true),
        joint_forces: Some(false),
        ..Options::default()
    };
    let mut scenes = (0..).map(|seed| random_scene(seed, options));
    scenes.find(|scene| scene.arm.as_ref().is_some_and(|arm| arm.base.is_some())).expect("a scene with an arm base")
}

/// A vehicle alone.
pub fn vehicle_alone() -> Scene {
    Scene { arm: None, payload: None, ..scene(false) }
}

/// A body without water.
pub fn dry(body: &Body) -> Body {
    let still = Body { volume: None, buoyancy: None, damping: Damping::default(), ..body.clone() };
    Body { added_mass: Matrix6::zeros(), ..still }
}

/// The scene without gravity, drag, joint friction and end stops.
pub fn lossless(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    scene.water.gravity = Vector3::zeros();
    scene.vehicle.forward_damping = None;
    for_bodies(&mut scene, |body| {
        body.buoyancy = None;
        body.damping = Damping::default();
    });
    if let Some(arm) = &mut scene.arm {
        for joint in arm.mount.joint.iter_mut().chain(arm.links.iter_mut().map(|link| &mut link.joint)) {
            joint.friction = Friction::default();
            joint.limits = None;
        }
    }
    scene
}

/// Changes every body.
pub fn for_bodies(scene: &mut Scene, change: impl Fn(&mut Body)) {
    change(&mut scene.vehicle.body);
    if let Some(arm) = &mut scene.arm {
        arm.base.iter_mut().for_each(&change);
        arm.links.iter_mut().for_each(|link| change(&mut link.body));
    }
    scene.payload.iter_mut().for_each(|payload| change(&mut payload.body));
}

/// A current, world axes.
pub fn current() -> Vector3<f64> {
    Vector3::new(0.4, -0.7, 0.2)
}

/// Six numbers in -1..1.
pub fn vector6(seed: u64) -> Vector6<f64> {
    let mut random = Random::new(seed);
    Vector6::from_fn(|_, _| random.between(-1.0, 1.0))
}

/// Everything that can push and pull on a scene, at once.
pub struct Push {
    pub thrust: Vec<f64>,
    pub external: Vec<Vector6<f64>>,
    pub joint_command: Vec<f64>,
}

impl Push {
    pub fn new(seed: u64, scene: &Scene) -> Self {
        let mut random = Random::new(seed);
        let mut numbers = |n| (0..n).map(|_| random.between(-10.0, 10.0)).collect();
        let thrust = numbers(scene.vehicle.thrusters.len());
        let joint_command: Vec<f64> = numbers(scene.joints().count());
        let external = (0..=joint_command.len() as u64).map(|i| 8.0 * vector6(seed + i)).collect();
        Self { thrust, external, joint_command }
    }

    pub fn loads(&self) -> Loads<'_> {
        Loads { thrust: &self.thrust, external: &self.external, joint_command: &self.joint_command, ..Loads::default() }
    }
}

/// Velocities `[V; q']` of a state.
pub fn velocities(state: &State, joints: usize) -> DVector<f64> {
    DVector::from_iterator(6 + joints, state.twist.iter().chain(&state.qd[..joints]).copied())
}

/// All numbers of a state as bits.
pub fn bits(state: &State) -> Vec<u64> {
    let State { position, rotation, twist, q, qd, thrust, time } = state;
    let vehicle = position.iter().chain(rotation.iter()).chain(twist.iter());
    vehicle.chain(q).chain(qd).chain(thrust).chain([time]).map(|x| x.to_bits()).collect()
}

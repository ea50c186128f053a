//! Scenes, simulators, states and loads of several tests.

use nalgebra::{DVector, Matrix6, Rotation3, Vector3, Vector6};
use uvms_gym::batch::{Inputs, Precision, Simulator, SimulatorOptions};
use uvms_gym::description::{Body, Damping, Detent, Friction, JointSpring, Scene};
use uvms_gym::dynamics::Loads;
use uvms_gym::dynamics::dense::{angular, linear, stack};
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

/// One random scene on a free vehicle: an arm base, three links in a chain and a payload, without friction and end stops.
pub fn scene(joint_loading: bool) -> Scene {
    let options = Options {
        links: Some(3),
        branching: Some(false),
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

/// The scene without gravity, drag, and friction, springs, detents and end stops of joints.
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
            (joint.limits, joint.spring, joint.detent) = (None, None, None);
        }
    }
    scene
}

/// The scene in a vacuum, without gravity, joint friction and end stops.
pub fn vacuum(scene: &Scene) -> Scene {
    let mut scene = lossless(scene);
    scene.water.density = 0.0;
    for_bodies(&mut scene, |body| *body = dry(body));
    scene
}

/// A body in water without gravity: 10 kg, its frame at its centre of mass.
pub fn body(change: impl FnOnce(&mut Body)) -> Scene {
    let mut scene = Scene::shipped("free-body").unwrap();
    scene.water.density = 1000.0;
    scene.vehicle.body.mass = 10.0;
    change(&mut scene.vehicle.body);
    scene.check().unwrap();
    scene
}

/// PETASUS-PUM with its links as a tree: two on the yaw joint, a chain, and one on the vehicle.
pub fn branched() -> Scene {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    scene.name = "petasus-pum, branched".into();
    for (link, parent) in scene.arm.as_mut().unwrap().links.iter_mut().zip(["base", "yaw", "yaw", "forearm", "vehicle"])
    {
        link.parent = Some(parent.into());
    }
    scene.check().unwrap();
    scene
}

/// PETASUS-PUM with springs, detents and static friction at its joints.
pub fn sprung() -> Scene {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    scene.name = "petasus-pum, sprung".into();
    for joint in scene.joints_mut() {
        let servo = joint.servo.as_ref().unwrap();
        joint.spring = Some(JointSpring { stiffness: 0.02 * servo.kp, rest: joint.home + 0.1 });
        joint.detent = Some(Detent { torque: 0.001 * servo.kp, period: 0.8, offset: 0.1 });
        let friction = &mut joint.friction;
        friction.break_away = Some(friction.coulomb + 0.01 * friction.viscous);
        friction.stribeck_speed = Some(0.4);
    }
    scene.check().unwrap();
    scene
}

/// A tumbling vehicle with added mass, restoring forces and drag; its arm swings without friction and end stops, which have kinks.
pub fn tumbling(quadratic: bool) -> (Scene, State) {
    tumbling_scene(Scene::shipped("petasus-pum").unwrap(), quadratic)
}

/// The same of a scene of five joints.
pub fn tumbling_scene(mut scene: Scene, quadratic: bool) -> (Scene, State) {
    if !quadratic {
        for_bodies(&mut scene, |body| body.damping.quadratic = Matrix6::zeros());
    }
    for joint in scene.joints_mut() {
        (joint.limits, joint.friction) = (None, Friction::default());
    }
    let mut state = State { rotation: Random::new(1).rotation(), q: scene.home(), ..State::default() };
    state.twist = Vector6::new(0.4, -0.3, 0.2, 0.9, -0.7, 0.8);
    state.qd[..5].copy_from_slice(&[0.5, -0.4, 0.6, -0.5, 0.4]);
    (scene, state)
}

/// Multiplies the gains of all servos.
pub fn with_gains(name: &str, factor: f64) -> Scene {
    let mut scene = Scene::shipped(name).unwrap();
    for servo in scene.joints_mut().filter_map(|joint| joint.servo.as_mut()) {
        (servo.kp, servo.kd) = (servo.kp * factor, servo.kd * factor);
    }
    if let Some(servo) = &mut scene.vehicle.servo {
        (servo.kp, servo.kd) = (servo.kp.map(|k| k * factor), servo.kd.map(|k| k * factor));
    }
    scene
}

/// Changes every body.
pub fn for_bodies(scene: &mut Scene, change: impl Fn(&mut Body)) {
    change(&mut scene.vehicle.body);
    if let Some(arm) = &mut scene.arm {
        arm.base.iter_mut().for_each(&change);
        arm.links.iter_mut().flat_map(|link| &mut link.body).for_each(&change);
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

/// Random loads of a scene, within its limits.
pub struct RandomLoads {
    pub thrust: Vec<f64>,
    pub joint_command: Vec<f64>,
    /// Wrench per moving body, as list and as vectors.
    external_list: Vec<f64>,
    pub external: Vec<Vector6<f64>>,
}

impl RandomLoads {
    pub fn new(seed: u64, scene: &Scene) -> Self {
        let mut random = Random::new(seed);
        let mut within = |size: f64, [lower, upper]: [f64; 2]| random.between(-size, size).clamp(lower, upper);
        let thrust = scene.vehicle.thrusters.iter().map(|thruster| within(20.0, thruster.limits)).collect();
        let efforts = scene.joints().map(|joint| joint.effort.unwrap_or(f64::INFINITY));
        let joint_command: Vec<f64> = efforts.map(|effort| within(5.0, [-effort, effort])).collect();
        let external_list: Vec<f64> = (0..6 * (joint_command.len() + 1)).map(|_| random.between(-3.0, 3.0)).collect();
        let external = external_list.chunks(6).map(Vector6::from_column_slice).collect();
        Self { thrust, joint_command, external_list, external }
    }

    pub fn loads(&self) -> Loads<'_> {
        Loads { thrust: &self.thrust, external: &self.external, joint_command: &self.joint_command, ..Loads::default() }
    }

    pub fn inputs(&self) -> Inputs<'_> {
        Inputs {
            thrust: Some(&self.thrust),
            joint_torque: Some(&self.joint_command),
            external: Some(&self.external_list),
            ..Inputs::default()
        }
    }
}

/// Velocities `[V; q']` of a state.
pub fn velocities(state: &State, joints: usize) -> DVector<f64> {
    DVector::from_iterator(6 + joints, state.twist.iter().chain(&state.qd[..joints]).copied())
}

/// Numbers of a state without thrusts and time.
pub fn numbers(state: &State) -> Vec<f64> {
    let vehicle = state.position.iter().chain(&state.rotation).chain(&state.twist);
    vehicle.chain(&state.q).chain(&state.qd).copied().collect()
}

/// All numbers of a state as bits.
pub fn bits(state: &State) -> Vec<u64> {
    numbers(state).into_iter().chain(state.thrust).chain([state.time]).map(f64::to_bits).collect()
}

/// Maximum difference of any entry of two states; NaN if one is not a number.
pub fn distance(a: &State, b: &State) -> f64 {
    let differences = numbers(a).into_iter().zip(numbers(b)).map(|(x, y)| (x - y).abs());
    differences.fold(0.0, |maximum: f64, x| if maximum.is_nan() || x <= maximum { maximum } else { x })
}

/// Both number types.
pub const PRECISIONS: [Precision; 2] = [Precision::Double, Precision::Single];

/// Instances of a scene.
pub fn batch(scene: &Scene, integrator: &str, dt: f64, precision: Precision, instances: usize) -> Simulator {
    let options = SimulatorOptions { integrator: integrator.into(), dt, precision, instances, ..Default::default() };
    Simulator::new(scene.clone(), options).unwrap()
}

/// One instance of a scene.
pub fn simulator(scene: &Scene, integrator: &str, dt: f64) -> Simulator {
    batch(scene, integrator, dt, Precision::Double, 1)
}

/// One instance of a scene at a state.
pub fn simulator_at(scene: &Scene, integrator: &str, dt: f64, state: &State) -> Simulator {
    let mut simulator = simulator(scene, integrator, dt);
    simulator.set_state(0, state);
    simulator
}

/// The state after `steps` steps under `inputs`.
pub fn run(scene: &Scene, integrator: &str, dt: f64, state: &State, inputs: &Inputs, steps: usize) -> State {
    let mut simulator = simulator_at(scene, integrator, dt, state);
    simulator.step(inputs, steps).unwrap();
    simulator.state(0)
}

/// The state after `steps` free steps.
pub fn drift(scene: &Scene, integrator: &str, dt: f64, state: &State, steps: usize) -> State {
    run(scene, integrator, dt, state, &Inputs::default(), steps)
}

/// Orders of convergence from errors at steps each half as long as the one before.
pub fn orders(errors: &[f64]) -> Vec<f64> {
    errors.windows(2).map(|pair| (pair[0] / pair[1]).log2()).collect()
}

/// Diagonal matrix.
pub fn diagonal(entries: [f64; 6]) -> Matrix6<f64> {
    Matrix6::from_diagonal(&entries.into())
}

/// `T exp xi`, twist, joints and rates of a state moved by `step` along coordinate `k` of `[xi; q; V; q']`.
pub fn moved(state: &State, joints: usize, k: usize, step: f64) -> State {
    let mut next = state.clone();
    let rates = 6 + joints;
    match k {
        0..3 => next.position += state.rotation.column(k) * step,
        3..6 => next.rotation *= Rotation3::new(Vector3::ith(k - 3, step)).into_inner(),
        _ if k < rates => next.q[k - 6] += step,
        _ if k < rates + 6 => next.twist[k - rates] += step,
        _ => next.qd[k - rates - 6] += step,
    }
    next
}

/// Derivative of the accelerations `[V'; q'']` along coordinate `k` of `[xi; q; V; q']`, by central differences.
pub fn slope(simulator: &mut Simulator, state: &State, inputs: &Inputs, k: usize) -> DVector<f64> {
    let [ahead, behind] = [1e-6, -1e-6].map(|step| {
        simulator.set_state(0, &moved(state, simulator.joints(), k, step));
        DVector::from_vec(simulator.forward_dynamics(inputs).unwrap())
    });
    (ahead - behind) / 2e-6
}

/// Wrench that gives a body of 10 kg and 1 kg m2, its frame at its centre of mass, the rates `[V']` at a twist.
pub fn wrench_of(rates: &[f64], twist: &Vector6<f64>) -> Vector6<f64> {
    let (v, w) = (linear(twist), angular(twist));
    let force = (Vector3::from_column_slice(&rates[..3]) + w.cross(&v)) * 10.0;
    stack(&force, &Vector3::from_column_slice(&rates[3..6]))
}

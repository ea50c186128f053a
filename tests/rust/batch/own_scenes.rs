//! Instances with scenes of their own: each is stepped as it would be alone, bit for bit.

use nalgebra::{Matrix6, Vector3, Vector6};
use uvms_gym::batch::{Inputs, Precision, Simulator, SimulatorOptions};
use uvms_gym::description::{
    Body, Detent, EndEffectorFrame, Fin, Frame, InertiaPoint, Joint, JointKind, JointLimits, JointServo, JointSpring,
    LinearActuator, Scene, Tether, ThrustMap,
};
use uvms_gym::error::SimulatorError;
use uvms_gym::system::{Factors, State};

use crate::batch::inputs::{RandomInputs, STRONG};
use crate::cases::bits;
use crate::random_scene::{Options, Random, random_scene, random_state};

/// Number of instances: no multiple of any width of lanes.
const N: usize = 19;

/// Changes every number of a scene: each by a factor of its own or, in a `gentle` way, so that all terms keep their form.
fn vary(scene: &Scene, seed: u64, gentle: bool) -> Scene {
    let mut scene = scene.clone();
    let mut random = Random::new(seed ^ 0xA11);
    let random = &mut random;
    scene.water.density *= factor(random);
    vary_vector(&mut scene.water.gravity, random, false);
    vary_vector(&mut scene.water.current, random, false);
    let vehicle = &mut scene.vehicle;
    vary_body(&mut vehicle.body, random, gentle);
    for thruster in &mut vehicle.thrusters {
        vary_vector(&mut thruster.position, random, false);
        vary_vector(&mut thruster.axis, random, false);
        thruster.axis.normalize_mut();
        vary_all(&mut thruster.limits, random);
        for number in [&mut thruster.lag, &mut thruster.dead_band, &mut thruster.ambient_flow, &mut thruster.deduction]
        {
            vary_option(number, random);
        }
        if let Some(ThrustMap::Points(points)) = &mut thruster.map {
            points.iter_mut().for_each(|[_, thrust]| *thrust *= factor(random));
            points.sort_by(|a, b| a[1].total_cmp(&b[1]));
        }
        thruster.induced.iter_mut().for_each(|induced| vary_all(induced, random));
    }
    vary_option(&mut vehicle.thruster_lag, random);
    vehicle.voltage = vehicle.voltage.map(|_| random.between(10.0, 20.0));
    for fin in &mut vehicle.fins {
        vary_vector(&mut fin.position, random, false);
        let numbers = [&mut fin.area, &mut fin.lift_slope, &mut fin.drag, &mut fin.induced_drag, &mut fin.plate];
        numbers.into_iter().for_each(|number| *number *= factor(random));
        vary_option(&mut fin.stall, random);
        fin.deflection += 0.1 * (factor(random) - 1.0);
    }
    if let Some(tether) = &mut vehicle.tether {
        vary_vector(&mut tether.position, random, false);
        let numbers = [&mut tether.length, &mut tether.diameter, &mut tether.mass_per_length, &mut tether.drag];
        numbers.into_iter().for_each(|number| *number *= factor(random));
    }
    if let Some(damping) = &mut vehicle.forward_damping {
        vary_vector(&mut damping.position, random, false);
        damping.matrix *= factor(random);
    }
    if let Some(servo) = &mut vehicle.servo {
        vary_all(&mut servo.kp, random);
        vary_all(&mut servo.kd, random);
    }
    if let Some(arm) = &mut scene.arm {
        vary_frame(&mut arm.mount.frame, random, gentle);
        arm.mount.joint.iter_mut().for_each(|joint| vary_joint(joint, random, gentle));
        arm.base.iter_mut().for_each(|body| vary_body(body, random, gentle));
        for link in &mut arm.links {
            if link.moves() {
                vary_joint(&mut link.joint, random, gentle);
            } else {
                vary_frame(&mut link.joint.frame, random, gentle);
            }
            link.body.iter_mut().for_each(|body| vary_body(body, random, gentle));
        }
        let mut frame = arm.end_effector.frame();
        vary_frame(&mut frame, random, gentle);
        arm.end_effector = EndEffectorFrame { on: arm.end_effector.on.clone(), ..frame.into() };
    }
    if let Some(payload) = &mut scene.payload {
        vary_frame(&mut payload.frame, random, gentle);
        vary_body(&mut payload.body, random, gentle);
    }
    scene.check().unwrap();
    scene
}

fn factor(random: &mut Random) -> f64 {
    random.between(0.9, 1.1)
}

fn vary_all<const K: usize>(numbers: &mut [f64; K], random: &mut Random) {
    numbers.iter_mut().for_each(|number| *number *= factor(random));
}

fn vary_option(number: &mut Option<f64>, random: &mut Random) {
    number.iter_mut().for_each(|number| *number *= factor(random));
}

fn vary_vector(vector: &mut Vector3<f64>, random: &mut Random, gentle: bool) {
    let along = factor(random);
    vector.iter_mut().for_each(|x| *x *= if gentle { along } else { factor(random) });
}

fn vary_frame(frame: &mut Frame, random: &mut Random, gentle: bool) {
    vary_vector(&mut frame.position, random, gentle);
    if !gentle {
        vary_vector(&mut frame.rpy, random, false);
    }
}

fn vary_body(body: &mut Body, random: &mut Random, gentle: bool) {
    let about_com = body.inertia_at == InertiaPoint::Com;
    let mass = factor(random);
    body.mass *= mass;
    body.inertia *= if about_com { factor(random) } else { mass };
    body.weight = None;
    for number in [&mut body.volume, &mut body.buoyancy] {
        vary_option(number, random);
    }
    let scale = Matrix6::from_diagonal(&Vector6::from_fn(|_, _| factor(random)));
    body.added_mass = scale * body.added_mass * scale;
    body.added_mass = (body.added_mass + body.added_mass.transpose()) / 2.0;
    for matrix in [&mut body.damping.linear, &mut body.damping.quadratic] {
        *matrix = scale * *matrix * scale * factor(random);
    }
    if gentle {
        // Points that coincide still do.
        let along = if about_com { factor(random) } else { 1.0 };
        body.center_of_mass *= along;
        body.center_of_buoyancy *= along;
        body.hydrodynamic_frame.position *= along;
    } else {
        vary_vector(&mut body.center_of_buoyancy, random, false);
        vary_frame(&mut body.hydrodynamic_frame, random, false);
    }
}

fn vary_joint(joint: &mut Joint, random: &mut Random, gentle: bool) {
    vary_frame(&mut joint.frame, random, gentle);
    if !gentle {
        vary_vector(&mut joint.axis, random, false);
        joint.axis.normalize_mut();
    }
    let friction = &mut joint.friction;
    for number in [&mut joint.rotor_inertia, &mut friction.viscous, &mut friction.coulomb, &mut friction.coulomb_speed]
    {
        *number *= factor(random);
    }
    if let Some(limits) = &mut joint.limits {
        limits.lower -= random.between(0.02, 0.1);
        limits.upper += random.between(0.02, 0.1);
        (limits.stiffness, limits.damping) = (limits.stiffness * factor(random), limits.damping * factor(random));
    }
    let speed = friction.stribeck_speed.iter_mut().chain(&mut friction.break_away);
    let spring = joint.spring.iter_mut().flat_map(|spring| [&mut spring.stiffness, &mut spring.rest]);
    let detents = joint.detent.iter_mut();
    let detent = detents.flat_map(|detent| [&mut detent.torque, &mut detent.period, &mut detent.offset]);
    for number in speed.chain(spring).chain(detent) {
        *number *= factor(random);
    }
    friction.break_away = friction.break_away.map(|value| value.max(1.1 * friction.coulomb));
    vary_option(&mut joint.effort, random);
    if let Some(servo) = &mut joint.servo {
        (servo.kp, servo.kd) = (servo.kp * factor(random), servo.kd * factor(random));
    }
    if let Some(actuator) = &mut joint.actuator {
        for number in [&mut actuator.base, &mut actuator.lever, &mut actuator.angle, &mut actuator.force] {
            *number *= factor(random);
        }
    }
    joint.home += random.between(-0.01, 0.01);
}

/// A scene with every term that random ones lack: thruster dynamics, fins, tether, damping by forward speed, geared joints, a linear actuator.
fn complete(mut scene: Scene) -> Scene {
    for (i, thruster) in scene.vehicle.thrusters.iter_mut().enumerate() {
        thruster.lag = (i % 2 == 0).then_some(0.1);
        thruster.dead_band = (i % 3 == 0).then_some(1.0);
        thruster.ambient_flow = Some(0.5);
        thruster.map = (i == 1).then(|| ThrustMap::Points(vec![[-20.0, -15.0], [0.0, 0.0], [10.0, 4.0], [20.0, 18.0]]));
        if i == 3 {
            thruster.map = Some(ThrustMap::T200);
        }
    }
    scene.vehicle.voltage = Some(16.0);
    let (chord, axis) = (Vector3::x(), Vector3::y());
    scene.vehicle.fins = vec![Fin {
        name: "tail".into(),
        position: Vector3::new(-0.5, 0.1, 0.05),
        chord,
        axis,
        area: 0.02,
        lift_slope: 3.0,
        drag: 0.02,
        induced_drag: 0.1,
        stall: Some(0.3),
        plate: 1.2,
        deflection: 0.1,
        limits: Some([-0.5, 0.5]),
    }];
    let position = Vector3::new(-0.3, 0.02, 0.2);
    scene.vehicle.tether = Some(Tether { position, length: 30.0, diameter: 0.01, mass_per_length: 0.1, drag: 1.1 });
    scene.vehicle.forward_damping = Some(crate::forward_damping::eca_a9());
    if let Some(arm) = &mut scene.arm {
        for (i, link) in arm.links.iter_mut().enumerate().filter(|(_, link)| link.moves()) {
            // Light links without a rotor would be too fast for the step.
            link.joint.rotor_inertia = if i % 2 == 0 { 0.05 } else { 0.02 };
            link.joint.servo = Some(JointServo { kp: 20.0, kd: 2.0 });
            link.joint.effort = Some(8.0);
            link.joint.spring = (i % 2 == 1).then_some(JointSpring { stiffness: 3.0, rest: 0.2 });
            link.joint.detent = (i % 3 != 0).then_some(Detent { torque: 0.2, period: 0.5, offset: 0.1 });
            if i % 2 == 0 {
                let friction = &mut link.joint.friction;
                (friction.break_away, friction.stribeck_speed) = (Some(friction.coulomb + 0.2), Some(0.3));
            }
            let (lower, upper) = (link.joint.home - 0.3, link.joint.home + 0.4);
            link.joint.limits = Some(JointLimits { lower, upper, stiffness: 50.0, damping: 1.0 });
            if link.joint.kind == JointKind::Revolute && i % 3 == 1 {
                link.joint.effort = None;
                let angle = std::f64::consts::FRAC_PI_2 - link.joint.home;
                link.joint.actuator = Some(LinearActuator { base: 0.2, lever: 0.05, angle, force: 100.0 });
            }
        }
    }
    scene.check().unwrap();
    scene
}

/// State and inputs of an instance.
struct Instance {
    scene: Scene,
    state: State,
    factors: Factors<f64>,
    inputs: RandomInputs,
}

impl Instance {
    fn new(seed: u64, scene: Scene, with_factors: bool) -> Self {
        let mut random = Random::new(seed ^ 0x0DD);
        let mut state = random_state(seed, &scene);
        // Far beyond the stops of a light finger their damping is too fast for the step.
        for (q, joint) in state.q.iter_mut().zip(scene.joints()) {
            if let Some(limits) = &joint.limits {
                *q = q.clamp(limits.lower - 0.1, limits.upper + 0.1);
            }
        }
        let mut factors = Factors::ONE;
        if with_factors && seed.is_multiple_of(2) {
            factors = Factors::from_array(std::array::from_fn(|_| random.between(0.7, 1.4)));
            factors.payload = if seed.is_multiple_of(4) { 0.5 } else { 0.0 };
        }
        let inputs = RandomInputs::new(seed, &scene, STRONG);
        Self { scene, state, factors, inputs }
    }
}

fn simulator(scenes: Vec<Scene>, instances: &[&Instance], options: &SimulatorOptions) -> Simulator {
    let options = SimulatorOptions { instances: instances.len(), ..options.clone() };
    let mut simulator = Simulator::with_scenes(scenes, options).unwrap();
    for (i, instance) in instances.iter().enumerate() {
        assert_eq!(simulator.state(i).q, instance.scene.home().map(|q| simulator_rounding(&simulator, q)));
        simulator.set_state(i, &instance.state);
    }
    simulator.set_factors(&instances.iter().map(|instance| instance.factors).collect::<Vec<_>>()).unwrap();
    simulator
}

fn simulator_rounding(simulator: &Simulator, x: f64) -> f64 {
    // A sum of two numbers holds it.
    let single = |x: f64| f64::from(x as f32);
    if simulator.options().precision == Precision::Single { single(x) + single(x - single(x)) } else { x }
}

/// Steps instances with scenes of their own together, and each alone.
fn check(what: &str, scene: &Scene, gentle: bool, options: &SimulatorOptions, with_factors: bool) {
    let instances: Vec<Instance> =
        (0..N as u64).map(|seed| Instance::new(seed, vary(scene, seed, gentle), with_factors)).collect();
    let scenes = instances.iter().map(|instance| instance.scene.clone()).collect();
    let mut batch = simulator(scenes, &instances.iter().collect::<Vec<_>>(), options);
    let all = RandomInputs::of_all(instances.iter().map(|instance| &instance.inputs));
    let inputs_of_all = all.inputs(scene);
    let width = 6 + scene.joints().count();
    let accelerations = batch.forward_dynamics(&inputs_of_all).unwrap();
    let linear: Vec<_> = (0..N).map(|i| batch.linearize(&inputs_of_all, i).unwrap()).collect();
    let loads = batch.applied_loads(&inputs_of_all).unwrap();
    let masses: Vec<_> = (0..N).map(|i| batch.closed_form(i, |form| form.mass_matrix().clone())).collect();
    batch.step(&inputs_of_all, 3).unwrap();
    batch.step(&inputs_of_all, 2).unwrap();
    for (i, instance) in instances.iter().enumerate() {
        let what = format!("{what}, {}, {:?}, instance {i}", options.integrator, options.precision);
        let mut alone = simulator(vec![instance.scene.clone()], &[instance], options);
        assert!(alone.scenes().is_none() && batch.scenes().is_some());
        let inputs = instance.inputs.inputs(scene);
        assert_eq!(accelerations[i * width..][..width], alone.forward_dynamics(&inputs).unwrap(), "{what}");
        assert_eq!(linear[i].a, alone.linearize(&inputs, 0).unwrap().a, "{what}");
        assert_eq!(loads[i], alone.applied_loads(&inputs).unwrap()[0], "{what}");
        assert_eq!(masses[i], alone.closed_form(0, |form| form.mass_matrix().clone()), "{what}");
        alone.step(&inputs, 3).unwrap();
        alone.step(&inputs, 2).unwrap();
        let state = batch.state(i);
        assert!(state.rotation.iter().chain(&state.twist).chain(&state.q).all(|x| x.is_finite()), "{what}");
        assert_eq!(bits(&state), bits(&alone.state(0)), "{what}");
        assert_ne!(bits(&state), bits(&batch.state((i + 1) % N)));
    }
}

/// Integrators that step in different ways: production methods, and baselines with terms of their own.
const INTEGRATORS: [&str; 4] = ["mk4", "ros2", "quaternion-rk4", "lagged-added-mass"];

fn check_all(what: &str, scene: &Scene, gentle: bool) {
    for integrator in INTEGRATORS {
        for precision in [Precision::Double, Precision::Single] {
            for with_factors in [false, true] {
                let integrator = integrator.into();
                let options = SimulatorOptions { integrator, precision, dt: 1e-3, ..SimulatorOptions::default() };
                check(what, scene, gentle, &options, with_factors);
            }
        }
    }
}

#[test]
fn shipped_scenes_of_single_instances() {
    for name in Scene::shipped_names() {
        check_all(name, &Scene::shipped(name).unwrap(), true);
    }
}

#[test]
fn scenes_of_single_instances_with_every_term() {
    for name in ["petasus-pum", "bluerov2-heavy-alpha5"] {
        check_all(name, &complete(Scene::shipped(name).unwrap()), true);
    }
}

#[test]
fn random_scenes_of_single_instances() {
    for seed in 0..6 {
        let options = Options { links: Some(seed as usize % 4), ..Options::default() };
        check_all(&format!("random-{seed}"), &random_scene(seed, options), false);
        check_all(&format!("complete random-{seed}"), &complete(random_scene(seed + 20, options)), false);
    }
}

/// In the widths of all instruction sets, and on threads.
#[test]
fn neighbours_and_threads_make_no_difference() {
    let scene = Scene::shipped("petasus-pum").unwrap();
    let scenes: Vec<Scene> = (0..700).map(|seed| vary(&scene, seed, true)).collect();
    let run = |scenes: &[Scene], threads| {
        let options =
            SimulatorOptions { instances: scenes.len(), threads: Some(threads), ..SimulatorOptions::default() };
        let mut simulator = Simulator::with_scenes(scenes.to_vec(), options).unwrap();
        simulator.step(&Inputs::default(), 5).unwrap();
        (0..scenes.len()).map(|i| bits(&simulator.state(i))).collect::<Vec<_>>()
    };
    let states = run(&scenes, 1);
    assert_eq!(states, run(&scenes, 2));
    assert_eq!(states[3..20], run(&scenes[3..20], 1));
}

type Change = fn(&mut Scene);

#[test]
fn scenes_of_another_structure_are_refused_by_place() {
    let scene = Scene::shipped("petasus-pum").unwrap();
    let of = |change: fn(&mut Scene)| {
        let mut other = scene.clone();
        change(&mut other);
        let options = SimulatorOptions { instances: 3, ..SimulatorOptions::default() };
        match Simulator::with_scenes(vec![scene.clone(), scene.clone(), other], options) {
            Err(error @ SimulatorError::Structure { .. }) => error.to_string(),
            Err(error) => panic!("{error}"),
            Ok(_) => panic!("no error"),
        }
    };
    let cases: [(&str, Change); 6] = [
        ("joints", |s| drop(s.arm.as_mut().unwrap().links.pop())),
        ("vehicle.thrusters", |s| drop(s.vehicle.thrusters.pop())),
        ("vehicle.fixed", |s| s.vehicle.fixed = true),
        ("arm.links[1].joint.friction", |s| s.arm.as_mut().unwrap().links[1].joint.friction.coulomb = 0.0),
        ("arm.links[1].joint.rotor_inertia", |s| s.arm.as_mut().unwrap().links[1].joint.rotor_inertia = 0.0),
        ("vehicle.servo", |s| s.vehicle.servo = None),
    ];
    for (place, change) in cases {
        let message = of(change);
        assert!(message.starts_with("scene 2 ('petasus-pum') differs in structure from scene 0: "), "{message}");
        assert!(message.contains(place), "{place}: {message}");
    }
}

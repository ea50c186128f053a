//! The articulated-body form against the closed form: two derivations of the same equations.

use std::f64::consts::FRAC_PI_2;

use crate::random_scene::{Options, Random, random_scene, random_state};
use nalgebra::{DMatrix, DVector, Rotation3, Unit, Vector3, Vector6};
use uvms_gym::batch::{Inputs, Precision, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::{ClosedFormModel, Loads};
use uvms_gym::hydro::{CoefficientFrame, CoefficientMatrix};
use uvms_gym::lane::Shared;
use uvms_gym::system::{Compiled, Factors, Flow, State, System, compile};

/// Random loads of a scene, in the layout of both forms.
struct RandomLoads {
    thrust: Vec<f64>,
    torque: Vec<f64>,
    external: Vec<f64>,
}

impl RandomLoads {
    fn new(seed: u64, scene: &Scene) -> Self {
        let mut random = Random::new(seed);
        let n = scene.joints().count();
        let mut numbers = |count: usize, size: f64| (0..count).map(|_| random.between(-size, size)).collect();
        let thrust: Vec<f64> = numbers(scene.vehicle.thrusters.len(), 20.0);
        let within =
            |(t, thruster): (f64, &uvms_gym::description::Thruster)| t.clamp(thruster.limits[0], thruster.limits[1]);
        let thrust = thrust.into_iter().zip(&scene.vehicle.thrusters).map(within).collect();
        let mut torque: Vec<f64> = numbers(n, 5.0);
        for (t, joint) in torque.iter_mut().zip(scene.joints()) {
            let effort = joint.effort.unwrap_or(f64::INFINITY);
            *t = t.clamp(-effort, effort);
        }
        Self { thrust, torque, external: numbers(6 * (n + 1), 3.0) }
    }

    fn inputs(&self) -> Inputs<'_> {
        Inputs {
            thrust: Some(&self.thrust),
            joint_torque: Some(&self.torque),
            external: Some(&self.external),
            ..Inputs::default()
        }
    }
}

/// Relative difference of the two forms' accelerations, condition number of M, relative residual of the articulated.
fn compare(scene: &Scene, state: &State, loads: &RandomLoads, precision: Precision) -> (f64, f64, f64) {
    let mut simulator =
        Simulator::new(scene.clone(), SimulatorOptions { precision, ..SimulatorOptions::default() }).unwrap();
    simulator.set_state(0, state);
    let weightless = scene.water.gravity.norm() == 0.0;
    let acceleration = if weightless { Vector3::zeros() } else { Vector3::new(0.3, -0.5, 0.2) };
    let flow = Flow { velocity: scene.water.current, acceleration };
    simulator.set_flow(0, flow);
    let articulated = DVector::from_vec(simulator.forward_dynamics(&loads.inputs()).unwrap());

    let external: Vec<Vector6<f64>> = loads.external.chunks(6).map(Vector6::from_column_slice).collect();
    let applied =
        Loads { thrust: &loads.thrust, external: &external, joint_command: &loads.torque, ..Loads::default() };
    let model = ClosedFormModel::new(scene).unwrap();
    let form = model.at(state, flow);
    let closed = form.accelerations(&applied).unwrap();
    let residual = form.residual(&articulated, &applied).unwrap();
    let first = if scene.vehicle.fixed { 6 } else { 0 };
    let free = form.mass_matrix().nrows() - first;
    let condition = if free == 0 {
        1.0
    } else {
        let eigenvalues = form.mass_matrix().view((first, first), (free, free)).symmetric_eigenvalues();
        eigenvalues.max() / eigenvalues.min()
    };
    let difference = (&articulated - &closed).norm() / closed.norm().max(1e-300);
    (difference, condition, residual.norm / residual.scale.max(1e-300))
}

#[test]
fn articulated_and_closed_form_agree_on_random_systems() {
    let (mut checked, mut worst, mut worst_residual) = (0, 0.0_f64, 0.0_f64);
    for seed in 0..300 {
        let scene = random_scene(seed, Options::default());
        let state = random_state(seed, &scene);
        let (difference, condition, residual) =
            compare(&scene, &state, &RandomLoads::new(seed, &scene), Precision::Double);
        assert!(residual < 1e-12, "seed {seed}: residual {residual:e}, condition {condition:e}");
        worst_residual = worst_residual.max(residual);
        if condition < 1e5 {
            checked += 1;
            worst = worst.max(difference);
            assert!(difference < 1e-12, "seed {seed}: {difference:e}, condition {condition:e}");
        }
    }
    println!("{checked} systems: maximum difference {worst:e}, maximum residual {worst_residual:e}");
    assert!(checked > 200, "only {checked} well-conditioned systems");
}

#[test]
fn articulated_and_closed_form_agree_on_shipped_scenes() {
    for name in Scene::shipped_names() {
        let scene = Scene::shipped(name).unwrap();
        for seed in 0..20 {
            let state = random_state(seed, &scene);
            let (difference, condition, residual) =
                compare(&scene, &state, &RandomLoads::new(seed, &scene), Precision::Double);
            assert!(residual < 1e-12, "{name} {seed}: residual {residual:e}");
            // Beyond 1e5 what two solvers may differ by grows with the condition number.
            let bar = 1e-12 * (condition / 1e5).max(1.0);
            assert!(difference < bar, "{name} {seed}: {difference:e}, condition {condition:e}");
        }
    }
}

/// Full damping matrices whose axes lie along the joint's are permuted; the remaining rotation is kept.
#[test]
fn full_damping_turned_about_joints_agrees_with_the_closed_form() {
    let mut turned = 0;
    for seed in 0..40 {
        let mut scene = Scene::shipped(["petasus-pum", "bluerov2-heavy-alpha5"][seed as usize % 2]).unwrap();
        let mut random = Random::new(seed);
        for link in &mut scene.arm.as_mut().unwrap().links {
            let [x, z] = [Vector3::x_axis(), Vector3::z_axis()]
                .map(|axis| Rotation3::from_axis_angle(&axis, FRAC_PI_2 * random.between(0.0, 4.0).floor()));
            let about = Unit::new_normalize(link.joint.axis);
            let (roll, pitch, yaw) =
                (Rotation3::from_axis_angle(&about, random.between(-3.0, 3.0)) * z * x).euler_angles();
            link.body.hydrodynamic_frame.rpy = Vector3::new(roll, pitch, yaw);
            for drag in [&mut link.body.damping.linear, &mut link.body.damping.quadratic] {
                drag.apply(|entry| *entry = random.between(-0.3, 1.0));
            }
        }
        for damping in compile(&scene).system.joints.iter().flat_map(|joint| &joint.body.damping) {
            let CoefficientFrame::General([[_, Shared(sin), _], _, [.., Shared(along)]], _) = damping.frame else {
                continue;
            };
            turned += usize::from(
                along == 1.0 && sin.abs() > 0.01 && matches!(damping.quadratic, CoefficientMatrix::Full(_)),
            );
        }
        let state = random_state(seed, &scene);
        let (difference, _, residual) = compare(&scene, &state, &RandomLoads::new(seed, &scene), Precision::Double);
        assert!(residual < 1e-12 && difference < 1e-12, "seed {seed}: {residual:e}, {difference:e}");
    }
    assert!(turned > 100, "{turned}");
}

#[test]
fn single_precision_agrees_to_its_own_accuracy() {
    for seed in 0..50 {
        let scene = random_scene(seed, Options::default());
        let state = random_state(seed, &scene);
        let (difference, condition, _) = compare(&scene, &state, &RandomLoads::new(seed, &scene), Precision::Single);
        assert!(difference < 1e-6 * condition, "seed {seed}: {difference:e}, condition {condition:e}");
    }
}

#[test]
fn a_current_changes_nothing_but_the_observer() {
    // Articulated form in a current against still water seen from the moving frame.
    for seed in 0..40 {
        let scene = random_scene(seed, Options { fixed: Some(false), ..Options::default() });
        let state = random_state(seed, &scene);
        let loads = RandomLoads::new(seed, &scene);
        let run = |current: nalgebra::Vector3<f64>, state: &State| {
            let mut simulator = Simulator::new(scene.clone(), SimulatorOptions::default()).unwrap();
            simulator.set_state(0, state);
            simulator.set_flow(0, current);
            simulator.step(&loads.inputs(), 20).unwrap();
            simulator.state(0)
        };
        let current = nalgebra::Vector3::new(0.4, -0.3, 0.2);
        let moving = run(current, &state);
        let still = run(nalgebra::Vector3::zeros(), &uvms_gym::dynamics::relative_to_water(&state, &current));
        let seen = uvms_gym::dynamics::relative_to_water(&moving, &current);
        assert!((seen.position - still.position).norm() < 1e-11);
        assert!((seen.rotation - still.rotation).norm() < 1e-11);
        assert!((seen.twist - still.twist).norm() < 1e-10 * still.twist.norm().max(1.0));
    }
}

#[test]
fn a_fixed_arm_obeys_the_joint_rows_only() {
    for seed in 0..40 {
        let scene = random_scene(seed, Options { fixed: Some(true), links: Some(4), ..Options::default() });
        let state = State { twist: Vector6::zeros(), ..random_state(seed, &scene) };
        let mut simulator = Simulator::new(scene.clone(), SimulatorOptions::default()).unwrap();
        simulator.set_state(0, &state);
        let loads = RandomLoads::new(seed, &scene);
        let a = simulator.forward_dynamics(&loads.inputs()).unwrap();
        assert!(a[..6].iter().all(|&x| x == 0.0));
        simulator.step(&loads.inputs(), 5).unwrap();
        assert_eq!(simulator.state(0).position, state.position);
        let turned: DMatrix<f64> = DMatrix::from_iterator(3, 3, simulator.state(0).rotation.iter().copied());
        let before: DMatrix<f64> = DMatrix::from_iterator(3, 3, state.rotation.iter().copied());
        assert_eq!(turned, before);
    }
}

#[test]
fn factors_on_parameters_give_the_scene_that_has_them() {
    for seed in 0..60 {
        check_factors(seed, random_scene(seed, Options { fixed: Some(seed % 7 == 0), ..Options::default() }));
    }
    // Links with central frames.
    for name in ["petasus-pum", "bluerov2-heavy-alpha5"] {
        for seed in 1..5 {
            check_factors(seed, Scene::shipped(name).unwrap());
        }
    }
}

/// Memory for the parameters of single instances is reused: earlier contents must have no effect.
#[test]
fn parameters_have_no_effect_on_later_instances() {
    let own = |i: usize, payload: f64| Factors { mass: 1.0 + 0.01 * i as f64, volume: 0.98, payload, ..Factors::ONE };
    for (n, integrator) in
        [(1, "mk4"), (1, "lagged-added-mass"), (200, "mk4"), (200, "lagged-added-mass"), (200, "mk4")]
    {
        for precision in [Precision::Double, Precision::Single] {
            let new = || {
                let options = SimulatorOptions {
                    instances: n,
                    precision,
                    integrator: integrator.into(),
                    ..SimulatorOptions::default()
                };
                Simulator::new(Scene::shipped("petasus-pum").unwrap(), options).unwrap()
            };
            let begin = |simulator: &mut Simulator, factors: &[Factors<f64>]| {
                simulator.set_factors(factors).unwrap();
                let state = State { twist: Vector6::repeat(0.2), ..State::default() };
                (0..n).for_each(|i| simulator.set_state(i, &state));
            };
            let (plain, varied, laden): (Vec<_>, Vec<_>, Vec<_>) =
                (vec![Factors::ONE; n], (0..n).map(|i| own(i, 0.0)).collect(), (0..n).map(|i| own(i, 3.0)).collect());
            let mixed: Vec<_> = (0..n).map(|i| [Factors::ONE, own(i, 1.0)][i / 80 % 2]).collect();
            let mut worn = new();
            for factors in [&varied, &plain, &laden, &varied, &plain, &mixed, &laden, &mixed, &plain] {
                let mut fresh = new();
                for simulator in [&mut worn, &mut fresh] {
                    begin(simulator, factors);
                    simulator.step(&Inputs::default(), 3).unwrap();
                }
                for i in 0..n {
                    assert_eq!(worn.state(i), fresh.state(i), "instance {i} of {n}, {integrator}, {precision:?}");
                }
            }
        }
    }
}

/// Payloads in the xz plane of the last joint's frame, and off it, where the inertia is not sparse.
#[test]
fn payloads_are_held_at_any_end_effector() {
    // (Seeds of motions that a step of 10 ms can follow.)
    let places = [([0.1, 0.0, 0.0], true), ([0.1, 0.2, 0.0], true), ([0.0, 0.0, 0.2], false), ([0.1, 0.2, 0.3], false)];
    for ((offset, sparse), seed) in places.into_iter().zip([1, 3, 5, 9]) {
        let mut scene = Scene::shipped("petasus-pum").unwrap();
        scene.arm.as_mut().unwrap().end_effector.position = offset.into();
        let Compiled { system, unscaled, payload_attachment, .. } = compile(&scene);
        let laden: System<f64> = system.allocate_scaled(&unscaled, Some(payload_attachment.map(Shared)));
        assert!(system.sparse && system.z_aligned);
        assert_eq!(laden.sparse, sparse, "{payload_attachment:?}");
        check_factors(seed, scene);
    }
}

fn check_factors(seed: u64, scene: Scene) {
    for integrator in ["mk4", "ros2"] {
        check_factors_by(integrator, seed, scene.clone());
    }
}

fn check_factors_by(integrator: &str, seed: u64, scene: Scene) {
    let mut state = random_state(seed, &scene);
    if scene.vehicle.fixed {
        state.twist = Vector6::zeros();
    }
    let loads = RandomLoads::new(seed, &scene);
    let mut random = Random::new(seed);
    let mut factors = Factors::from_array(std::array::from_fn(|_| random.between(0.6, 1.5)));
    (factors.payload, factors.thrust) = (if seed.is_multiple_of(2) { 0.0 } else { random.between(0.1, 5.0) }, 1.0);
    let varied = scene.varied(factors.of_bodies());

    // The second instance of three, so that its neighbours differ.
    let alone = SimulatorOptions { integrator: integrator.into(), dt: 0.001, ..SimulatorOptions::default() };
    let mut simulator = Simulator::new(scene.clone(), SimulatorOptions { instances: 3, ..alone.clone() }).unwrap();
    simulator.set_factors(&[Factors::ONE, factors, Factors::ONE]).unwrap();
    let mut twin = Simulator::new(varied.clone(), alone.clone()).unwrap();
    let mut plain = Simulator::new(scene, alone).unwrap();
    for k in 0..3 {
        simulator.set_state(k, &state);
    }
    twin.set_state(0, &state);
    plain.set_state(0, &state);
    let three = |x: &[f64]| x.repeat(3);
    let (thrust, torque, external) = (three(&loads.thrust), three(&loads.torque), three(&loads.external));
    let inputs =
        Inputs { thrust: Some(&thrust), joint_torque: Some(&torque), external: Some(&external), ..Inputs::default() };
    simulator.step(&inputs, 20).unwrap();
    twin.step(&loads.inputs(), 20).unwrap();
    plain.step(&loads.inputs(), 20).unwrap();
    for (k, other) in [(0, &plain), (1, &twin), (2, &plain)] {
        let (a, b) = (simulator.state(k), other.state(0));
        assert!(
            (a.twist - b.twist).norm() < 1e-10 * b.twist.norm().max(1.0),
            "{integrator}, seed {seed}, instance {k}"
        );
        assert!((a.position - b.position).norm() < 1e-11, "{integrator}, seed {seed}, instance {k}");
    }
    let mass = simulator.closed_form(1, |form| form.mass_matrix().clone());
    assert!((mass.clone() - twin.closed_form(0, |form| form.mass_matrix().clone())).norm() < 1e-9 * mass.norm());
}

/// `T exp xi`, twist, joints and rates of a state moved by `step` along coordinate `k` of `[xi; q; V; q']`.
fn moved(state: &State, n: usize, k: usize, step: f64) -> State {
    let mut next = state.clone();
    let rates = 6 + n;
    match k {
        0..3 => next.position += state.rotation.column(k) * step,
        3..6 => {
            let turn = nalgebra::Rotation3::new(nalgebra::Vector3::ith(k - 3, step));
            next.rotation = state.rotation * turn.matrix();
        }
        _ if k < rates => next.q[k - 6] += step,
        _ if k < rates + 6 => next.twist[k - rates] += step,
        _ => next.qd[k - rates - 6] += step,
    }
    next
}

#[test]
fn linearization_is_the_derivative_of_the_accelerations() {
    for seed in 0..30 {
        let scene = random_scene(seed, Options { fixed: Some(seed % 5 == 0), ..Options::default() });
        let n = scene.joints().count();
        let mut state = random_state(seed, &scene);
        if scene.vehicle.fixed {
            state.twist = Vector6::zeros();
        }
        let loads = RandomLoads::new(seed, &scene);
        let inputs = loads.inputs();
        let mut simulator = Simulator::new(scene, SimulatorOptions::default()).unwrap();
        simulator.set_state(0, &state);
        let linear = simulator.linearize(&inputs, 0).unwrap();

        let step = 1e-6;
        let mut at = |state: &State, inputs: &Inputs| {
            simulator.set_state(0, state);
            DVector::from_vec(simulator.forward_dynamics(inputs).unwrap())
        };
        let rates = 6 + n;
        for k in 0..2 * rates {
            let ahead = at(&moved(&state, n, k, step), &inputs);
            let behind = at(&moved(&state, n, k, -step), &inputs);
            let numeric = (ahead - behind) / (2.0 * step);
            let exact = linear.a.view((rates, k), (rates, 1)).column(0).into_owned();
            let scale = exact.norm().max(linear.a.norm() * 1e-3).max(1.0);
            assert!((&numeric - &exact).norm() < 1e-4 * scale, "seed {seed}, column {k}: {numeric} {exact}");
        }
        for k in 0..6 {
            let mut wrench = [0.0; 6];
            let mut with = |x: f64| {
                wrench[k] = x;
                at(&state, &Inputs { wrench: Some(&wrench), ..inputs })
            };
            let numeric = (with(1.0) - with(-1.0)) / 2.0;
            let exact = linear.b.view((rates, k), (rates, 1)).column(0).into_owned();
            assert!((&numeric - &exact).norm() < 1e-9 * exact.norm().max(1.0), "seed {seed}, wrench {k}");
        }
    }
}

//! The articulated-body form against the closed form: two derivations of the same equations.

use std::f64::consts::FRAC_PI_2;

use crate::cases::{PRECISIONS, RandomLoads, batch, run, simulator_at, slope};
use crate::random_scene::{Options, Random, random_scene, random_state};
use nalgebra::{DVector, Rotation3, Unit, Vector3, Vector6};
use uvms_gym::batch::{Inputs, Precision};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::ClosedFormModel;
use uvms_gym::hydro::{CoefficientFrame, CoefficientMatrix};
use uvms_gym::lane::Shared;
use uvms_gym::system::{Compiled, Factors, Flow, State, System, compile};

/// Relative difference of the two forms' accelerations, condition number of M, relative residual of the articulated.
fn compare(scene: &Scene, state: &State, loads: &RandomLoads, precision: Precision) -> (f64, f64, f64) {
    let mut simulator = batch(scene, "mk4", 0.01, precision, 1);
    simulator.set_state(0, state);
    let weightless = scene.water.gravity.norm() == 0.0;
    let acceleration = if weightless { Vector3::zeros() } else { Vector3::new(0.3, -0.5, 0.2) };
    let flow = Flow { velocity: scene.water.current, acceleration };
    simulator.set_flow(0, flow);
    let articulated = DVector::from_vec(simulator.forward_dynamics(&loads.inputs()).unwrap());

    let applied = loads.loads();
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
            let body = link.body.as_mut().unwrap();
            body.hydrodynamic_frame.rpy = Vector3::new(roll, pitch, yaw);
            for drag in [&mut body.damping.linear, &mut body.damping.quadratic] {
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
fn factors_on_parameters_give_the_scene_that_has_them() {
    for seed in 0..60 {
        check_factors(seed, &random_scene(seed, Options { fixed: Some(seed % 7 == 0), ..Options::default() }));
    }
    // Links with central frames.
    for name in ["petasus-pum", "bluerov2-heavy-alpha5"] {
        for seed in 1..5 {
            check_factors(seed, &Scene::shipped(name).unwrap());
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
        for precision in PRECISIONS {
            let new = || batch(&Scene::shipped("petasus-pum").unwrap(), integrator, 0.01, precision, n);
            let state = State { twist: Vector6::repeat(0.2), ..State::default() };
            let all = |factors: &dyn Fn(usize) -> Factors<f64>| (0..n).map(factors).collect::<Vec<_>>();
            let [plain, varied, laden] = [all(&|_| Factors::ONE), all(&|i| own(i, 0.0)), all(&|i| own(i, 3.0))];
            let mixed = all(&|i| [Factors::ONE, own(i, 1.0)][i / 80 % 2]);
            let mut worn = new();
            for factors in [&varied, &plain, &laden, &varied, &plain, &mixed, &laden, &mixed, &plain] {
                let mut fresh = new();
                for simulator in [&mut worn, &mut fresh] {
                    simulator.set_factors(factors).unwrap();
                    (0..n).for_each(|i| simulator.set_state(i, &state));
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
        check_factors(seed, &scene);
    }
}

fn check_factors(seed: u64, scene: &Scene) {
    let state = random_state(seed, scene);
    let loads = RandomLoads::new(seed, scene);
    let mut random = Random::new(seed);
    let mut factors = Factors::from_array(std::array::from_fn(|_| random.between(0.6, 1.5)));
    (factors.payload, factors.thrust) = (if seed.is_multiple_of(2) { 0.0 } else { random.between(0.1, 5.0) }, 1.0);
    let varied = scene.varied(factors.of_bodies());

    // The second instance of three, so that its neighbours differ.
    for integrator in ["mk4", "ros2"] {
        let mut simulator = batch(scene, integrator, 0.001, Precision::Double, 3);
        simulator.set_factors(&[Factors::ONE, factors, Factors::ONE]).unwrap();
        (0..3).for_each(|k| simulator.set_state(k, &state));
        let inputs = loads.inputs();
        let [thrust, torque, external] =
            [inputs.thrust, inputs.joint_torque, inputs.external].map(|all| all.unwrap().repeat(3));
        let repeated = Inputs {
            thrust: Some(&thrust),
            joint_torque: Some(&torque),
            external: Some(&external),
            ..Inputs::default()
        };
        simulator.step(&repeated, 20).unwrap();
        let [plain, twin] = [scene, &varied].map(|scene| run(scene, integrator, 0.001, &state, &inputs, 20));
        for (k, b) in [(0, &plain), (1, &twin), (2, &plain)] {
            let (a, what) = (simulator.state(k), format!("{integrator}, seed {seed}, instance {k}"));
            assert!((a.twist - b.twist).norm() < 1e-10 * b.twist.norm().max(1.0), "{what}");
            assert!((a.position - b.position).norm() < 1e-11, "{what}");
        }
        let mass = simulator.closed_form(1, |form| form.mass_matrix().clone());
        let expected =
            simulator_at(&varied, integrator, 0.001, &twin).closed_form(0, |form| form.mass_matrix().clone());
        assert!((&mass - expected).norm() < 1e-9 * mass.norm());
    }
}

#[test]
fn linearization_is_the_derivative_of_the_accelerations() {
    for seed in 0..30 {
        let scene = random_scene(seed, Options { fixed: Some(seed % 5 == 0), ..Options::default() });
        let n = scene.joints().count();
        let state = random_state(seed, &scene);
        let loads = RandomLoads::new(seed, &scene);
        let inputs = loads.inputs();
        let mut simulator = simulator_at(&scene, "mk4", 0.01, &state);
        let linear = simulator.linearize(&inputs, 0).unwrap();
        let rates = 6 + n;
        for k in 0..2 * rates {
            let numeric = slope(&mut simulator, &state, &inputs, k);
            let exact = linear.a.view((rates, k), (rates, 1)).column(0).into_owned();
            let scale = exact.norm().max(linear.a.norm() * 1e-3).max(1.0);
            assert!((&numeric - &exact).norm() < 1e-4 * scale, "seed {seed}, column {k}: {numeric} {exact}");
        }
        simulator.set_state(0, &state);
        for k in 0..6 {
            let mut wrench = [0.0; 6];
            let mut with = |x: f64| {
                wrench[k] = x;
                DVector::from_vec(simulator.forward_dynamics(&Inputs { wrench: Some(&wrench), ..inputs }).unwrap())
            };
            let numeric = (with(1.0) - with(-1.0)) / 2.0;
            let exact = linear.b.view((rates, k), (rates, 1)).column(0).into_owned();
            assert!((&numeric - &exact).norm() < 1e-9 * exact.norm().max(1.0), "seed {seed}, wrench {k}");
        }
    }
}

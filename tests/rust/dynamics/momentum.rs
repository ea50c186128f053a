//! Composite body in lanes, and predictions with it, against the closed form.

use crate::cases::velocities;
use crate::random_scene::{Options, Random, random_scene, random_state};
use nalgebra::{DMatrix, DVector, Vector3, Vector6};
use uvms_gym::control::{AppliedWrenches, ArmState, NominalModel, VehicleMotion};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::aba::Scratch;
use uvms_gym::dynamics::dense::stack;
use uvms_gym::dynamics::{ClosedFormModel, CompositeBody, Loads};
use uvms_gym::lie;
use uvms_gym::system::{State, compile, rotation_vector};

fn scenes() -> impl Iterator<Item = Scene> {
    let free = Options { fixed: Some(false), ..Options::default() };
    let random = (0..40).map(move |seed| random_scene(seed, free));
    Scene::shipped_names()
        .into_iter()
        .map(|name| Scene::shipped(name).unwrap())
        .filter(|s| !s.vehicle.fixed)
        .chain(random)
}

fn gap(a: &lie::Vector6<f64>, b: &Vector6<f64>) -> f64 {
    (Vector6::from(a.to_array()) - b).amax() / b.amax().max(1.0)
}

#[test]
fn the_composite_body_is_the_sum_of_the_closed_form() {
    for (seed, scene) in scenes().enumerate() {
        let state = random_state(seed as u64, &scene);
        let system = compile(&scene).system;
        let gravity = lie::Vector3(state.rotation.tr_mul(&scene.water.gravity).into());
        let twist = lie::Vector6::from_array(state.twist.into());
        let whole = CompositeBody::of(&system, gravity, twist, (&state.q, &state.qd), &mut Scratch::<f64>::new());

        let model = ClosedFormModel::new(&scene).unwrap();
        let form = model.at(&state, Vector3::zeros());
        let mass = form.mass_matrix();
        let momentum = (mass * velocities(&state, form.joints())).fixed_rows::<6>(0).into_owned();
        assert!(gap(&whole.momentum, &momentum) < 1e-12, "{}: {}", scene.name, gap(&whole.momentum, &momentum));
        for i in 0..6 {
            for k in 0..6 {
                let miss = (whole.inertia.entry(i, k) - mass[(i, k)]).abs();
                assert!(miss < 1e-12 * mass.amax(), "{}: M[{i}][{k}] is off by {miss}", scene.name);
            }
        }
        let wrenches: Vec<f64> =
            form.damping().iter().zip(form.restoring()).flat_map(|(a, b)| (a + b).data.0[0]).collect();
        let force = form.wrench_influence() * DVector::from_vec(wrenches);
        let force = force.fixed_rows::<6>(0).into_owned();
        assert!(gap(&whole.force, &force) < 1e-12, "{}: {}", scene.name, gap(&whole.force, &force));
    }
}

/// A level scene's vehicle somewhere, and its arm.
fn somewhere(seed: u64, scene: &Scene) -> (State, VehicleMotion<f64>, ArmState<f64>) {
    let state = random_state(seed, scene);
    let error = stack(&state.rotation.tr_mul(&state.position), &rotation_vector(&state.rotation));
    let motion = VehicleMotion {
        error: lie::Vector6::from_array(error.into()),
        twist: lie::Vector6::from_array(state.twist.into()),
    };
    let arm = ArmState { q: state.q, qd: state.qd };
    (state, motion, arm)
}

fn wrenches(seed: u64) -> AppliedWrenches<f64> {
    let mut random = Random::new(seed);
    let mut six = || lie::Vector6::from_array(std::array::from_fn(|_| random.between(-20.0, 20.0)));
    AppliedWrenches { command: six(), thrust: six(), disturbance: six() }
}

/// The arm a little later, at steady rates.
fn later(arm: &ArmState<f64>, time: f64) -> ArmState<f64> {
    let mut then = *arm;
    then.q.iter_mut().zip(&arm.qd).for_each(|(q, qd)| *q += time * qd);
    then
}

#[test]
fn predictions_start_as_the_closed_form_says() {
    // Without thrusters nothing lags.
    for (seed, mut scene) in scenes().filter(|scene| !scene.vehicle.thrusters.is_empty()).enumerate() {
        scene.vehicle.set_thruster_lag(0.1);
        let (state, motion, arm) = somewhere(seed as u64, &scene);
        let wrenches = wrenches(seed as u64);
        let time = 1e-6;
        let then = NominalModel::new(&scene).predict(
            &motion,
            [&arm, &later(&arm, time)],
            &wrenches,
            time,
            &mut Scratch::new(),
        );
        let rate = (then.motion.twist - motion.twist).to_array();
        let model = ClosedFormModel::new(&scene).unwrap();
        let form = model.at(&state, Vector3::zeros());
        let mut accelerations = DVector::zeros(6 + form.joints());
        accelerations.rows_mut(0, 6).copy_from_slice(&rate.map(|x| x / time));
        let needed = form.inverse_dynamics(&accelerations, &Loads::default()).unwrap().wrench;
        let given = wrenches.thrust + wrenches.disturbance;
        let scale = (form.mass_matrix() * DMatrix::from_element(6 + form.joints(), 1, 1.0)).amax();
        let miss = (Vector6::from(given.to_array()) - needed).amax() / scale;
        assert!(miss < 3e-4, "{}: {miss}", scene.name);
    }
}

#[test]
fn predictions_are_of_second_order() {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    scene.vehicle.set_thruster_lag(0.1);
    let model = NominalModel::new(&scene);
    let (_, motion, arm) = somewhere(3, &scene);
    let wrenches = wrenches(3);
    let over = |time: f64, pieces: usize| {
        let (mut motion, mut arm, mut wrenches) = (motion, arm, wrenches);
        for _ in 0..pieces {
            let then = later(&arm, time / pieces as f64);
            let reached = model.predict(&motion, [&arm, &then], &wrenches, time / pieces as f64, &mut Scratch::new());
            (motion, wrenches.thrust) = (reached.motion, reached.thrust);
            arm = then;
        }
        motion
    };
    let error = |time: f64| {
        let (one, many) = (over(time, 1), over(time, 64));
        let far = |a: lie::Vector6<f64>, b: lie::Vector6<f64>| (a - b).dot(a - b);
        (far(one.error, many.error) + far(one.twist, many.twist)).sqrt()
    };
    let (long, short) = (error(0.08), error(0.04));
    assert!(long < 0.01, "{long}");
    assert!(long / short > 6.5, "the error of half the step is {} of the error of the step", short / long);
}

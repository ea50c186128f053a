//! Water that accelerates.

use nalgebra::{Matrix3, Rotation3, Vector3};
use uvms_gym::batch::{Inputs, Simulator, States};
use uvms_gym::description::{Body, Scene};
use uvms_gym::dynamics::dense::{angular, linear, stack};
use uvms_gym::dynamics::relative_to_water;
use uvms_gym::error::SimulatorError;
use uvms_gym::system::{Flow, State};

use crate::cases::{self, RandomLoads, diagonal, drift, for_bodies, simulator_at};
use crate::random_scene::{Options, random_scene, random_state};

const VELOCITY: Vector3<f64> = Vector3::new(0.4, -0.3, 0.2);
const ACCELERATION: Vector3<f64> = Vector3::new(0.05, 0.08, -0.06);

/// A body in water under gravity, its frame at its centre of mass.
fn body(change: impl FnOnce(&mut Body)) -> Scene {
    let mut scene = cases::body(change);
    scene.water.gravity = Vector3::new(0.0, 0.0, -9.81);
    scene
}

/// `scene` at `state` in a flow of this acceleration.
fn flowing(scene: &Scene, integrator: &str, state: &State, acceleration: Vector3<f64>) -> Simulator {
    let mut simulator = simulator_at(scene, integrator, 0.01, state);
    simulator.set_flow(0, Flow { velocity: VELOCITY, acceleration });
    simulator
}

#[test]
fn body_as_heavy_as_water_drifts_with_it_wherever_it_turns() {
    let scene = body(|body| {
        body.volume = Some(0.01);
        body.added_mass = diagonal([3.0, 25.0, 11.0, 2.0, 4.0, 3.0]);
        body.damping.linear = diagonal([5.0, 6.0, 7.0, 0.0, 0.0, 0.0]);
        body.damping.quadratic = diagonal([15.0, 16.0, 17.0, 0.0, 0.0, 0.0]);
    });
    // It turns as one with this inertia in a vacuum.
    let mut dry = cases::body(|body| body.inertia = Matrix3::from_diagonal(&Vector3::new(3.0, 5.0, 4.0)));
    dry.water.density = 0.0;
    let rotation = Rotation3::new(Vector3::new(0.3, -1.1, 0.6)).into_inner();
    let twist = stack(&rotation.tr_mul(&VELOCITY), &Vector3::new(0.4, -0.5, 0.3));
    let start = State { rotation, twist, ..State::default() };
    let spin = State { twist: stack(&Vector3::zeros(), &angular(&twist)), ..start.clone() };
    for acceleration in [Vector3::zeros(), ACCELERATION] {
        for integrator in ["mk4", "mk2", "rk4-normalise"] {
            let mut simulator = flowing(&scene, integrator, &start, acceleration);
            // In uneven parts, since the current goes on from call to call.
            for steps in [1, 299, 700] {
                simulator.step(&Inputs::default(), steps).unwrap();
            }
            let (end, flow) = (simulator.state(0), simulator.flow(0));
            let expected = VELOCITY + acceleration * 10.0;
            assert!((flow.velocity - expected).norm() < 1e-13);
            assert!((end.rotation * linear(&end.twist) - expected).norm() < 1e-12, "{integrator}");
            let travelled = VELOCITY * 10.0 + acceleration * 50.0;
            assert!((end.position - travelled).norm() < 1e-11, "{integrator}: {}", end.position - travelled);
            let spun = drift(&dry, integrator, 0.01, &spin, 1000);
            assert!((angular(&end.twist) - angular(&spun.twist)).norm() < 1e-12, "{integrator}");
        }
    }
}

#[test]
fn val_sphere_in_accelerating_water_obeys_morisons_inertia_force() {
    // (m + m_a) v' = (rho vol + m_a) a_c + (m - rho vol) g: no drag.
    let (m, volume, m_a) = (10.0, 0.004, 2.0);
    let scene = body(|body| {
        body.volume = Some(volume);
        body.added_mass = diagonal([m_a, m_a, m_a, 0.0, 0.0, 0.0]);
    });
    let displaced = 1000.0 * volume;
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let rate = (ACCELERATION * (displaced + m_a) + gravity * (m - displaced)) / (m + m_a);
    let mut simulator = flowing(&scene, "mk4", &State::default(), ACCELERATION);
    let first = simulator.forward_dynamics(&Inputs::default()).unwrap();
    assert!((Vector3::from_column_slice(&first[..3]) - rate).norm() < 1e-14);
    simulator.step(&Inputs::default(), 300).unwrap();
    let end = simulator.state(0);
    assert!((linear(&end.twist) - rate * 3.0).norm() < 1e-12);
    assert!((end.position - rate * 4.5).norm() < 1e-12);
}

#[test]
fn moving_water_is_still_water_under_another_gravity() {
    // Seen by who drifts along: g - a_c for g.
    for (seed, acceleration) in (0..40).flat_map(|seed| [Vector3::zeros(), ACCELERATION].map(|a| (seed, a))) {
        let mut scene = random_scene(seed, Options { fixed: Some(false), ..Options::default() });
        // A buoyancy in newtons would stand for another volume under another gravity.
        let water = scene.water.clone();
        for_bodies(&mut scene, |body| (body.volume, body.buoyancy) = (Some(body.displaced_volume(&water)), None));
        let (state, loads) = (random_state(seed, &scene), RandomLoads::new(seed, &scene));
        let mut moving = flowing(&scene, "mk4", &state, acceleration);
        let mut other = scene.clone();
        other.water.gravity -= acceleration;
        let seen = relative_to_water(&state, &VELOCITY);
        let mut still = simulator_at(&other, "mk4", 0.01, &seen);
        still.set_flow(0, Vector3::zeros());
        for simulator in [&mut moving, &mut still] {
            simulator.step(&loads.inputs(), 20).unwrap();
        }
        let (moving, still, t) = (moving.state(0), still.state(0), 0.2);
        let drifted = moving.position - state.position - VELOCITY * t - acceleration * (0.5 * t * t);
        let miss = (drifted - (still.position - seen.position)).norm();
        assert!(miss < 1e-11, "seed {seed}: {miss:e}");
        assert!((moving.rotation - still.rotation).norm() < 1e-11);
        let water = moving.rotation.tr_mul(&(VELOCITY + acceleration * t));
        let relative = moving.twist - stack(&water, &Vector3::zeros());
        assert!((relative - still.twist).norm() < 1e-10 * still.twist.norm().max(1.0));
    }
}

#[test]
fn held_vehicle_stays_and_its_arm_feels_the_flow() {
    for seed in 0..40 {
        let scene = random_scene(seed, Options { fixed: Some(true), links: Some(4), ..Options::default() });
        let (state, loads) = (random_state(seed, &scene), RandomLoads::new(seed, &scene));
        let [still, steady, accelerating] = [None, Some(Vector3::zeros()), Some(ACCELERATION)].map(|acceleration| {
            let mut simulator = match acceleration {
                None => simulator_at(&scene, "mk4", 0.01, &state),
                Some(acceleration) => flowing(&scene, "mk4", &state, acceleration),
            };
            let rates = simulator.forward_dynamics(&loads.inputs()).unwrap();
            assert!(rates[..6].iter().all(|&x| x == 0.0));
            simulator.step(&loads.inputs(), 10).unwrap();
            let end = simulator.state(0);
            assert_eq!((end.position, end.rotation, end.twist), (state.position, state.rotation, state.twist));
            rates
        });
        assert!(accelerating != steady && still != steady);
    }
}

#[test]
fn water_without_weight_does_not_accelerate() {
    let scene = Scene::shipped("free-body").unwrap();
    let mut simulator = simulator_at(&scene, "mk4", 0.01, &State::default());
    let states = States { current_acceleration: Some(&[0.0, 0.1, 0.0]), ..States::default() };
    let refused = simulator.set_states(&states);
    assert!(matches!(refused, Err(SimulatorError::Weightless { instance: 0, .. })), "{refused:?}");
}

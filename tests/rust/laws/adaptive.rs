//! The adaptive pair: its error follows the tolerance, whatever the step, and each instance has pieces of its own.

use nalgebra::Vector6;
use uvms_gym::batch::{Inputs, Precision, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::error::SimulatorError;
use uvms_gym::system::State;

use crate::cases::{bits, distance, drift, numbers, run, tumbling};
use crate::random_scene::random_state;

/// One instance at each of `starts`, by an integrator with a tolerance.
fn simulator(
    scene: &Scene,
    (integrator, tolerance): (&str, f64),
    precision: Precision,
    dt: f64,
    starts: &[State],
) -> Simulator {
    let (integrator, instances) = (integrator.into(), starts.len());
    let options = SimulatorOptions { integrator, tolerance, dt, precision, instances, ..SimulatorOptions::default() };
    let mut simulator = Simulator::new(scene.clone(), options).unwrap();
    starts.iter().enumerate().for_each(|(i, start)| simulator.set_state(i, start));
    simulator
}

fn adaptive(scene: &Scene, tolerance: f64, dt: f64, starts: &[State]) -> Simulator {
    simulator(scene, ("mk54", tolerance), Precision::Double, dt, starts)
}

/// The state after `steps` free steps.
fn arrive(scene: &Scene, tolerance: f64, dt: f64, state: &State, steps: usize) -> State {
    let mut simulator = adaptive(scene, tolerance, dt, std::slice::from_ref(state));
    simulator.step(&Inputs::default(), steps).unwrap();
    simulator.state(0)
}

#[test]
fn error_follows_the_tolerance_whatever_the_step() {
    let (scene, start) = tumbling(false);
    let end = drift(&scene, "mk4", 2.0 / 8192.0, &start, 8192);
    for steps in [1, 10, 100] {
        let mut before = f64::INFINITY;
        for exponent in 3..=11 {
            let tolerance = 10.0_f64.powi(-exponent);
            let error = distance(&end, &arrive(&scene, tolerance, 2.0 / steps as f64, &start, steps));
            println!("{steps} steps, tolerance {tolerance:e}: error {error:.2e}");
            // Short steps may be better than was asked for, never worse.
            assert!(error < 200.0 * tolerance, "{error:e} at {tolerance:e}");
            if steps == 1 {
                assert!(error > 0.01 * tolerance, "{error:e} at {tolerance:e}");
                assert!(error < 0.5 * before, "{error:e} after {before:e}");
            }
            before = error;
        }
    }
}

/// Kinks of friction, end stops and quadratic drag, and an arm driven against its stops by its motors.
#[test]
fn kinks_are_resolved_to_the_tolerance_too() {
    let scene = Scene::shipped("bluerov2-heavy-alpha5").unwrap();
    let start = State { twist: Vector6::new(0.4, -0.2, 0.1, 0.3, 0.5, -0.4), q: scene.home(), ..State::default() };
    let inputs = Inputs { joint_torque: Some(&[3.0, 4.0, -4.0, 1.0]), ..Inputs::default() };
    let end = run(&scene, "mk4", 2e-5, &start, &inputs, 100_000);
    for tolerance in [1e-5, 1e-7, 1e-9] {
        let mut simulator = adaptive(&scene, tolerance, 0.05, std::slice::from_ref(&start));
        simulator.step(&inputs, 40).unwrap();
        let error = distance(&end, &simulator.state(0));
        println!("tolerance {tolerance:e}: error {error:.2e}");
        assert!(error < 50.0 * tolerance, "{error:e} at {tolerance:e}");
    }
}

#[test]
fn every_instance_has_its_own_pieces() {
    let scene = Scene::shipped("petasus-pum").unwrap();
    let spinning = State { twist: Vector6::new(0.3, 0.0, 0.1, 6.0, -4.0, 9.0), q: scene.home(), ..State::default() };
    let lost = State { twist: Vector6::new(0.0, f64::NAN, 0.0, 0.0, 0.0, 0.0), ..spinning.clone() };
    let run = |states: &[State]| {
        let mut simulator = adaptive(&scene, 1e-9, 0.1, states);
        simulator.step(&Inputs::default(), 5).unwrap();
        (0..states.len()).map(|i| simulator.state(i)).collect::<Vec<_>>()
    };
    let mut states: Vec<State> = (0..17).map(|i| random_state(i, &scene)).collect();
    (states[3], states[9]) = (spinning, lost);
    let together = run(&states);
    for (i, state) in states.iter().enumerate() {
        let alone = run(std::slice::from_ref(state));
        if i == 9 {
            assert!(numbers(&together[i]).iter().any(|x| x.is_nan()));
        } else {
            assert_eq!(bits(&together[i]), bits(&alone[0]), "instance {i}");
        }
    }
}

/// The piece that an instance plans is part of what is saved, and of nothing that a new state keeps.
#[test]
fn a_new_state_begins_afresh() {
    let (scene, start) = tumbling(true);
    let starts = [start];
    let mut simulator = adaptive(&scene, 1e-8, 0.05, &starts);
    let mut run = || {
        simulator.set_state(0, &starts[0]);
        simulator.step(&Inputs::default(), 20).unwrap();
        simulator.save()
    };
    let first = run();
    assert_eq!(first, run());
    let mut other = adaptive(&scene, 1e-8, 0.05, &starts);
    other.load(&first).unwrap();
    simulator.step(&Inputs::default(), 3).unwrap();
    other.step(&Inputs::default(), 1).unwrap();
    other.step(&Inputs::default(), 2).unwrap();
    assert_eq!(distance(&simulator.state(0), &other.state(0)), 0.0);
}

#[test]
fn what_too_many_pieces_could_not_follow_is_lost() {
    let scene = Scene::shipped("free-body").unwrap();
    let spin = |speed: f64| State { twist: Vector6::new(0.1, 0.0, 0.0, 0.0, 0.0, speed), ..State::default() };
    assert!(arrive(&scene, 1e-6, 0.1, &spin(1e3), 1).twist.iter().all(|x| x.is_finite()));
    assert!(arrive(&scene, 1e-6, 0.1, &spin(1e8), 1).twist.iter().all(|x| x.is_nan()));
}

#[test]
fn tolerance_is_a_positive_number() {
    for tolerance in [0.0, -1e-6, f64::NAN, f64::INFINITY] {
        let options = SimulatorOptions { integrator: "mk54".into(), tolerance, ..SimulatorOptions::default() };
        let error = Simulator::new(Scene::shipped("free-body").unwrap(), options).err().expect("refused");
        assert!(matches!(error, SimulatorError::Tolerance { .. }), "{error}");
        assert!(error.to_string().contains(&format!("tolerance is {tolerance}")), "{error}");
    }
}

/// Where single precision ends: tumbles multiply rounding, some of them much more than others.
fn single_precision_errors(starts: &[State], integrator: &str, tolerance: f64, dt: f64) -> Vec<f64> {
    let (scene, _) = tumbling(false);
    let run = |integrator: &str, precision: Precision, dt: f64| {
        let mut simulator = simulator(&scene, (integrator, tolerance), precision, dt, starts);
        simulator.step(&Inputs::default(), (2.0 / dt).round() as usize).unwrap();
        (0..starts.len()).map(|i| simulator.state(i)).collect::<Vec<_>>()
    };
    let exact = run("mk4", Precision::Double, 2.0 / 8192.0);
    let ends = run(integrator, Precision::Single, dt);
    let mut errors: Vec<f64> = exact.iter().zip(&ends).map(|(a, b)| distance(a, b)).collect();
    errors.sort_by(f64::total_cmp);
    errors
}

/// Single precision comes down to its rounding and no further, without a piece too many: to where fixed steps end.
#[test]
fn single_precision_has_a_floor() {
    let (_, first) = tumbling(false);
    let starts: Vec<State> = (0..33)
        .map(|k| State { twist: first.twist.map(|x| x * (1.0 + 0.003 * f64::from(k))), ..first.clone() })
        .collect();
    let floor = single_precision_errors(&starts, "mk4", 1e-8, 0.01)[16];
    for tolerance in [1e-4, 1e-6, 1e-12] {
        let errors = single_precision_errors(&starts, "mk54", tolerance, 0.05);
        println!(
            "float32, tolerance {tolerance:e}: {:.2e} to {:.2e}, median {:.2e}",
            errors[0], errors[32], errors[16]
        );
        println!("fixed steps: {floor:.2e}");
        assert!(errors[16] < (20.0 * tolerance).max(2.0 * floor), "{:e} at {tolerance:e}", errors[16]);
    }
}

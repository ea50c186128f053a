//! The run-time estimate of `h |lambda|`: right for single modes, loud where a step is too long, silent otherwise.

use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3, Vector6};
use uvms_gym::batch::Inputs;
use uvms_gym::description::Scene;
use uvms_gym::system::State;

use crate::cases::{self, PRECISIONS, batch, simulator_at, with_gains};
use crate::random_scene::Random;

const SEVERAL: [&str; 2] = ["mk4", "mk3"];

fn body() -> Scene {
    cases::body(|body| body.volume = Some(0.01))
}

#[test]
fn val_real_mode_shows_its_rate() {
    let mut scene = body();
    for rate in [0.1, 1.0, 10.0, 25.0, 27.0, 40.0] {
        scene.vehicle.body.damping.linear = Matrix6::identity() * (10.0 * rate);
        for integrator in SEVERAL.into_iter().chain(["mk2"]) {
            let state = State { twist: Vector6::new(0.3, 0.0, 0.0, 0.0, 0.0, 0.0), ..State::default() };
            let mut simulator = simulator_at(&scene, integrator, 0.1, &state);
            assert_eq!(simulator.stiffness(0), 0.0);
            simulator.step(&Inputs::default(), 8).unwrap();
            let seen = simulator.stiffness(0);
            println!("{integrator}: h lambda = {:.2}, seen {seen:.4}", 0.1 * rate);
            assert!((seen / (0.1 * rate) - 1.0).abs() < 1e-3, "{integrator}, {rate}: {seen}");
        }
    }
}

#[test]
fn val_oscillation_shows_its_frequency() {
    // A pendulum about its centre of buoyancy: omega^2 = m g d / (I - (m d)^2 / m).
    let mut scene = body();
    scene.water.gravity = Vector3::new(0.0, 0.0, -9.81);
    scene.vehicle.body.center_of_mass = Vector3::new(0.0, 0.0, -0.1);
    for omega in [3.0, 5.0, 20.0, 27.0, 29.0] {
        scene.vehicle.body.inertia = Matrix3::identity() * (10.0 * 9.81 * 0.1 / (omega * omega));
        let rotation = Rotation3::new(Vector3::y() * 1e-3).into_inner();
        for integrator in SEVERAL {
            if integrator == "mk3" && omega > 17.0 {
                continue;
            }
            let mut simulator = simulator_at(&scene, integrator, 0.1, &State { rotation, ..State::default() });
            simulator.step(&Inputs::default(), 100).unwrap();
            let seen = simulator.stiffness(0);
            println!("{integrator}: h omega = {:.2}, seen {seen:.4}", 0.1 * omega);
            // A mode that dies or grows fast counts most at one phase.
            let bound = if omega > 10.0 { 0.35 } else { 0.05 };
            assert!((seen / (0.1 * omega) - 1.0).abs() < bound, "{integrator}, {omega}: {seen}");
        }
    }
}

/// Gains a hundred times too high: the joints rattle at a step that is too long for them, and the estimate says so
/// whether they diverge or stay finite.
#[test]
fn a_step_too_long_is_seen() {
    let mut scene = with_gains("petasus-pum", 100.0);
    scene.joints_mut().for_each(|joint| joint.effort = None);
    let home = scene.home();
    let target: Vec<f64> = home[..5].iter().map(|q| q + 0.05).collect();
    for precision in PRECISIONS {
        for integrator in ["mk4", "mk3", "mk2"] {
            let mut simulator = batch(&scene, integrator, 0.01, precision, 1);
            let mut maximum = 0.0_f64;
            for _ in 0..50 {
                simulator.step(&Inputs { joint_target: Some(&target), ..Inputs::default() }, 1).unwrap();
                maximum = maximum.max(simulator.stiffness(0));
            }
            println!("{integrator}, {precision:?}: seen {maximum:.2}, q' {:?}", &simulator.state(0).qd[..5]);
            assert!(maximum > 2.5, "{integrator}, {precision:?}: {maximum}");
        }
    }
}

/// Shipped scenes, driven by their thrusters, at the default step: at most the rate of a light link's friction.
#[test]
fn motion_of_the_shipped_scenes_is_slow_for_their_step() {
    for name in Scene::shipped_names() {
        let scene = Scene::shipped(name).unwrap();
        let thrusters = scene.vehicle.thrusters.len();
        for precision in PRECISIONS {
            let mut random = Random::new(7);
            let mut simulator = batch(&scene, "mk4", 0.01, precision, 16);
            let mut maximum = 0.0_f64;
            for _ in 0..40 {
                let thrust: Vec<f64> = (0..16 * thrusters).map(|_| random.between(-20.0, 20.0)).collect();
                simulator.step(&Inputs { thrust: Some(&thrust), ..Inputs::default() }, 5).unwrap();
                maximum = (0..16).fold(maximum, |maximum, i| maximum.max(simulator.stiffness(i)));
            }
            println!("{name}, {precision:?}: {maximum:.3}");
            assert!(maximum < 1.6, "{name}, {precision:?}: {maximum}");
        }
    }
}

/// Only the last digits change at rest under gravity, in a current, in both precisions.
#[test]
fn noise_of_rounding_is_no_motion() {
    for name in Scene::shipped_names() {
        let mut scene = Scene::shipped(name).unwrap();
        scene.water.current = Vector3::new(0.3, -0.2, 0.1);
        for precision in PRECISIONS {
            let mut simulator = batch(&scene, "mk4", 0.01, precision, 1);
            // Long enough to come to rest, by the water or by the servos.
            let target = scene.home()[..scene.joints().count()].to_vec();
            let servo = scene.joints().any(|joint| joint.servo.is_some());
            let inputs = Inputs { joint_target: servo.then_some(&target[..]), ..Inputs::default() };
            let mut late = 0.0_f64;
            for second in 0..60 {
                simulator.step(&inputs, 100).unwrap();
                if second > 40 {
                    late = late.max(simulator.stiffness(0));
                }
            }
            println!("{name}, {precision:?}: {late:.3}");
            assert!(late < 1.0, "{name}, {precision:?}: {late}");
        }
    }
}

#[test]
fn val_error_of_a_decaying_motion_is_that_of_its_steps() {
    // One step makes R(z) of v where e^z is right: z^(p + 1) / (p + 1)! wrong.
    let mut scene = body();
    for z in [0.1, 0.3] {
        scene.vehicle.body.damping.linear = Matrix6::identity() * (10.0 * z / 0.1);
        let state = State { twist: Vector6::ith(0, 0.3), ..State::default() };
        for (integrator, share) in [("mk4", z.powi(5) / 120.0), ("mk3", z.powi(4) / 24.0), ("mk2", z.powi(3) / 6.0)] {
            let mut simulator = simulator_at(&scene, integrator, 0.1, &state);
            simulator.step(&Inputs::default(), 1).unwrap();
            let expected = share * f64::exp(z);
            let seen = simulator.step_error(0);
            assert!((seen / expected - 1.0).abs() < 0.1 * z + 0.02, "{integrator} at {z}: {seen:e}, {expected:e}");
        }
        let mut implicit = simulator_at(&scene, "ros2", 0.1, &state);
        implicit.step(&Inputs::default(), 1).unwrap();
        let wrong = (implicit.state(0).twist[0] / 0.3 - f64::exp(-z)).abs() * f64::exp(z);
        let seen = implicit.step_error(0);
        assert!(seen > 0.5 * wrong && seen < 3.0 * wrong, "{z}: {seen:e}, {wrong:e}");
    }
}

#[test]
fn straight_flight_of_a_body_that_spins_counts_as_wrong_and_a_steady_spin_does_not() {
    let scene = body();
    let (theta, h, steps) = (0.5, 0.01, 20);
    let after = |twist: Vector6<f64>, integrator: &str| {
        let mut simulator = simulator_at(&scene, integrator, h, &State { twist, ..State::default() });
        simulator.step(&Inputs::default(), steps).unwrap();
        simulator.step_error(0)
    };
    let spin = Vector6::ith(5, theta / h);
    for (integrator, factor) in
        [("mk4", theta.powi(4) / 120.0), ("mk3", theta.powi(3) / 24.0), ("mk2", theta.powi(2) / 6.0)]
    {
        let seen = after(spin + Vector6::ith(0, 1.0), integrator);
        let expected = steps as f64 * factor * 2.0 * f64::sin(theta / 2.0);
        // The velocity itself shrinks or grows by what is wrong.
        assert!((seen / expected - 1.0).abs() < 0.2, "{integrator}: {seen:e}, {expected:e}");
        assert_eq!(after(spin, integrator), 0.0);
    }
}

#[test]
fn start_from_rest_under_a_steady_push_is_right() {
    let scene = body();
    for integrator in ["mk4", "mk3", "mk2", "ros2"] {
        let mut simulator = simulator_at(&scene, integrator, 0.1, &State::default());
        for _ in 0..20 {
            simulator.step(&Inputs { wrench: Some(&[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), ..Inputs::default() }, 1).unwrap();
            assert!(simulator.step_error(0) < 1e-12, "{integrator}: {:e}", simulator.step_error(0));
        }
    }
}

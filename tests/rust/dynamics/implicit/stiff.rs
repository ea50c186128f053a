//! Stiff cases on which explicit methods fail: steps of 0.1 s against rates of up to 1e6 1/s.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use uvms_gym::batch::{Inputs, Precision};
use uvms_gym::description::{JointLimits, Scene};
use uvms_gym::system::State;

use crate::cases::{self, PRECISIONS, batch, diagonal, distance, drift, run, simulator_at, with_gains};

const STEP: f64 = 0.1;

/// A body of 10 kg in water without gravity.
fn body() -> Scene {
    cases::body(|body| body.inertia = Matrix3::from_diagonal(&Vector3::new(0.3, 0.4, 0.5)))
}

/// States after each of `steps` free steps.
fn states(scene: &Scene, integrator: &str, precision: Precision, start: &State, steps: usize) -> Vec<State> {
    let mut simulator = batch(scene, integrator, STEP, precision, 1);
    simulator.set_state(0, start);
    let step = |_| {
        simulator.step(&Inputs::default(), 1).unwrap();
        simulator.state(0)
    };
    (0..steps).map(step).collect()
}

#[test]
fn stiff_linear_damping_decays_at_every_step() {
    for rate in [1.0, 1e2, 1e4, 1e6] {
        for precision in PRECISIONS {
            let mut scene = body();
            scene.vehicle.body.damping.linear = diagonal([10.0, 10.0, 10.0, 0.3, 0.4, 0.5]) * rate;
            let start = State { twist: Vector6::new(1.0, -2.0, 0.5, 0.0, 0.0, 1.0), ..State::default() };
            let mut before = start.twist.norm();
            for state in states(&scene, "ros2", precision, &start, 5) {
                let after = state.twist.norm();
                assert!(after < before, "rate {rate}: {before} to {after}");
                before = after;
            }
            assert!(rate < 1e3 || before < 1e-9);
        }
    }
}

#[test]
fn quadratic_drag_slows_a_body_at_50_m_per_s_as_its_closed_form_does() {
    for coefficient in [1.0, 100.0, 1e5] {
        let mut scene = body();
        scene.vehicle.body.damping.quadratic[(0, 0)] = coefficient;
        let start = State { twist: Vector6::new(50.0, 0.0, 0.0, 0.0, 0.0, 0.0), ..State::default() };
        for (k, state) in states(&scene, "ros2", Precision::Double, &start, 100).iter().enumerate() {
            let time = STEP * (k + 1) as f64;
            let truth = 50.0 / (1.0 + coefficient / 10.0 * 50.0 * time);
            // The secant makes implicit Euler exact here, whatever the step.
            assert!((state.twist[0] - truth).abs() < 1e-12 * 50.0, "{coefficient}, step {k}: {}", state.twist[0]);
        }
    }
}

#[test]
fn shipped_vehicles_slow_down_from_50_m_per_s_without_turning_back() {
    for name in Scene::shipped_names() {
        let scene = Scene::shipped(name).unwrap();
        if scene.vehicle.body.damping.quadratic[(0, 0)] == 0.0 {
            continue;
        }
        for precision in PRECISIONS {
            let twist = Vector6::new(50.0, 0.0, 0.0, 0.0, 0.0, 0.0);
            let start = State { twist, q: scene.home(), ..State::default() };
            let mut speed = 50.0;
            for state in states(&scene, "ros2", precision, &start, 50) {
                speed = state.twist.fixed_rows::<3>(0).norm();
                assert!(speed.is_finite() && state.twist.norm() < 200.0, "{name}: {}", state.twist);
            }
            assert!(speed < 5.0, "{name} still at {speed} m/s");
        }
    }
}

#[test]
fn a_stiff_pendulum_stays_within_its_swing() {
    for ratio in [1.0, 10.0, 100.0] {
        // Neutral, centre of mass below the centre of buoyancy; omega^2 = m g d / (I - ...) for small swings.
        let mut scene = body();
        let omega: f64 = ratio / STEP;
        scene.vehicle.body.volume = Some(0.01);
        scene.vehicle.body.center_of_buoyancy = Vector3::new(0.0, 0.0, 0.2);
        scene.water.gravity = Vector3::new(0.0, 0.0, -omega * omega * 0.3 / (10.0 * 0.2));
        for angle in [0.1, 1.5, 2.5] {
            let (sin, cos) = f64::sin_cos(angle);
            let rotation = Matrix3::new(1.0, 0.0, 0.0, 0.0, cos, -sin, 0.0, sin, cos);
            let start = State { rotation, ..State::default() };
            for state in states(&scene, "ros2", Precision::Double, &start, 200) {
                let tilt = state.rotation[(2, 2)];
                assert!(tilt > cos - 1e-2, "h omega = {ratio}, from {angle}: tilt {}", tilt.acos());
            }
        }
    }
}

#[test]
fn lift_beyond_drag_is_no_engine() {
    // Decay through lift far beyond drag is slowed down by the bound that replaces it, but stays a decay.
    for (lift, stiffness, bar) in [(0.5, 1e4, 1e-12), (2.0, 1e4, 1e-3), (10.0, 1e4, 1.0), (2.0, 10.0, 1e-12)] {
        let mut scene = body();
        let d = &mut scene.vehicle.body.damping.linear;
        *d = Matrix6::identity() * stiffness;
        for (i, k) in [(0, 1), (1, 2), (0, 4), (3, 5)] {
            (d[(i, k)], d[(k, i)]) = (lift * stiffness, -lift * stiffness);
        }
        let start = State { twist: Vector6::new(1.0, -1.0, 0.5, 0.2, -0.1, 0.3), ..State::default() };
        let ends = states(&scene, "ros2", Precision::Double, &start, 300);
        let maximum = ends.iter().map(|state| state.twist.norm()).fold(0.0, f64::max);
        let last = ends[299].twist.norm();
        println!("lift {lift} of {stiffness}: maximum {maximum:.3}, last {last:.3e}");
        assert!(maximum < 2.0 && last < bar, "lift {lift} of {stiffness}");
    }
}

/// Final distance of joints and vehicle from their targets.
fn off_target(scene: &Scene, integrator: &str, steps: usize) -> f64 {
    let start = State { q: scene.home(), ..State::default() };
    let n = scene.joints().count();
    let target: Vec<f64> = (0..n).map(|k| start.q[k] + if k % 2 == 0 { 0.3 } else { -0.2 }).collect();
    let station = [0.2, -0.1, 0.1, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let inputs = Inputs { joint_target: Some(&target), pose_target: Some(&station), ..Inputs::default() };
    let end = run(scene, integrator, STEP, &start, &inputs, steps);
    let joints = (0..n).map(|k| (end.q[k] - target[k]).abs().max(end.qd[k].abs()));
    let vehicle = [(end.position - Vector3::new(0.2, -0.1, 0.1)).amax(), end.twist.amax()];
    joints.chain(vehicle).fold(0.0, |maximum, x| if x <= maximum { maximum } else { x })
}

#[test]
fn gains_a_hundred_times_too_high_still_reach_the_target() {
    for name in ["petasus-pum", "bluerov2-heavy-alpha5"] {
        let scene = with_gains(name, 100.0);
        let (implicit, explicit) = (off_target(&scene, "ros2", 1200), off_target(&scene, "mk4", 1200));
        println!("{name}: off target by {implicit:.2e} with ros2, {explicit:.2e} with mk4");
        assert!(implicit < 0.02, "{name}: {implicit}");
        assert!(explicit.is_nan() || explicit > 1.0, "{name}: mk4 was to diverge, {explicit}");
    }
}

#[test]
fn a_link_a_millionth_of_the_vehicle_swings_with_friction() {
    for precision in PRECISIONS {
        let mut scene = Scene::shipped("petasus-pum").unwrap();
        let mass = scene.vehicle.body.mass;
        let link = scene.arm.as_mut().unwrap().links.last_mut().unwrap();
        let body = link.body.as_mut().unwrap();
        let factor = 1e-6 * mass / body.mass;
        body.mass *= factor;
        body.inertia *= factor;
        body.volume = body.volume.map(|v| v * factor);
        body.buoyancy = body.buoyancy.map(|b| b * factor);
        body.added_mass *= factor;
        link.joint.friction.viscous = 0.5;
        let mut start = State { q: scene.home(), ..State::default() };
        start.qd[4] = 0.5;
        start.twist = Vector6::new(0.3, -0.2, 0.1, 0.2, -0.3, 0.2);
        let ends = states(&scene, "ros2", precision, &start, 300);
        assert!(ends.iter().all(|state| state.twist.norm() < 1.0 && state.qd.iter().all(|x| x.abs() < 2.0)));
        assert!(ends[299].qd[4].abs() < 1e-2);
        if precision == Precision::Double {
            let fine = drift(&scene, "ros2", 0.001, &start, 1000);
            let error = distance(&ends[9], &fine);
            println!("light link: error at 0.1 s after 1 s {error:.2e}");
            assert!(error < 0.05, "{error}");
        }
    }
}

#[test]
fn a_stop_that_is_hit_at_speed_gives_no_energy() {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    scene.vehicle.fixed = true;
    for link in &mut scene.arm.as_mut().unwrap().links {
        let home = link.joint.home;
        link.joint.limits = Some(JointLimits { lower: home - 0.13, upper: home + 0.13, stiffness: 1e6, damping: 0.0 });
    }
    let mut start = State { q: scene.home(), ..State::default() };
    start.qd[..5].copy_from_slice(&[2.0, -1.5, 2.0, -2.0, 2.0]);
    let kinetic = |state: &State| {
        let energy = simulator_at(&scene, "mk4", STEP, state).closed_form(0, |form| form.energy());
        energy.kinetic_rigid + energy.kinetic_added
    };
    let before = kinetic(&start);
    for (k, state) in states(&scene, "ros2", Precision::Double, &start, 100).iter().enumerate() {
        let after = kinetic(state);
        assert!(after < 1.5 * before, "step {k}: {before} J to {after} J");
        for j in 0..5 {
            assert!((state.q[j] - start.q[j]).abs() < 0.4, "step {k}, joint {j}: {}", state.q[j] - start.q[j]);
        }
    }
}

#[test]
fn a_fast_tumble_takes_substeps_in_its_own_lane_only() {
    let scene = body();
    let still = State::default();
    let fast = State { twist: Vector6::new(0.1, 0.0, 0.0, 12.0, 9.0, -14.0), ..State::default() };
    let mut together = batch(&scene, "ros2", STEP, Precision::Double, 3);
    for (i, state) in [&still, &fast, &still].into_iter().enumerate() {
        together.set_state(i, state);
    }
    together.step(&Inputs::default(), 20).unwrap();
    let alone = drift(&scene, "ros2", STEP, &fast, 20);
    assert_eq!(together.state(1), alone);
    assert_eq!(together.state(0), drift(&scene, "ros2", STEP, &still, 20));
    // Energy and momentum of the torque-free body after 2 s, or some 6 turns.
    let inertia = scene.vehicle.body.inertia;
    let momentum = |s: &State| s.rotation * (inertia * s.twist.fixed_rows::<3>(3));
    let error = (momentum(&alone) - momentum(&fast)).norm() / momentum(&fast).norm();
    println!("fast tumble: momentum off by {error:.2e}");
    assert!(error < 0.3, "{error}");
    let lost = State { twist: Vector6::new(0.0, 0.0, 0.0, 1e5, 0.0, 1e5), ..State::default() };
    assert!(drift(&scene, "ros2", STEP, &lost, 1).twist[3].is_nan());
}

//! Table 1 of Han & Chung: the free body that spins about z, and its rivals. See NOTATION.md on what the table prints.

use std::f64::consts::TAU;

use nalgebra::Vector6;
use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::system::State;

/// Yaw in 0..2 pi at 499.9 s and at 500 s, h = 0.1 s, read from the rotation as the integrator has it.
fn yaws(integrator: &str, gamma: f64) -> [f64; 2] {
    let scene = Scene::shipped("free-body").unwrap();
    let options = SimulatorOptions { dt: 0.1, integrator: integrator.into(), gamma, ..SimulatorOptions::default() };
    let mut simulator = Simulator::new(scene, options).unwrap();
    simulator.set_state(0, &State { twist: Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 1.0), ..State::default() });
    [4999, 1].map(|steps| {
        simulator.step(&Inputs::default(), steps).unwrap();
        let r = simulator.state(0).rotation;
        r[(1, 0)].atan2(r[(0, 0)]).rem_euclid(TAU)
    })
}

#[test]
fn val_munthe_kaas_has_the_exact_yaw_at_both_instants() {
    for integrator in ["mk4", "mk4-truncated", "mk3", "mk2", "mk1"] {
        let yaw = yaws(integrator, 0.0);
        for (yaw, time) in yaw.into_iter().zip([499.9_f64, 500.0]) {
            let error = (yaw - time.rem_euclid(TAU)).abs();
            println!("{integrator} at {time} s: {yaw:.9}, error {error:.1e}");
            assert!(error < 1e-9, "{integrator} at {time} s: {yaw}");
        }
        assert!((yaw[0] - 3.52836).abs() < 5e-6 && (yaw[1] - 3.62836).abs() < 5e-6);
    }
}

#[test]
fn val_quaternion_by_rk4_is_near_for_any_moderate_gain() {
    for gamma in [0.0, 0.1, 1.0, 5.0, 10.0, 20.0] {
        let [yaw, _] = yaws("quaternion-rk4", gamma);
        println!("RK4, gamma = {gamma}: {yaw:.4}");
        assert!((3.5282..3.5289).contains(&yaw), "gamma {gamma}: {yaw}");
    }
    let [yaw, _] = yaws("rk4-normalise", 0.0);
    assert!((3.5282..3.5289).contains(&yaw), "{yaw}");
}

#[test]
fn val_printed_yaw_of_the_rival_appears_at_the_edge_of_stability_or_with_euler() {
    let [edge, _] = yaws("quaternion-rk4", 27.2);
    let [euler, _] = yaws("quaternion-euler", 0.24);
    println!("RK4, gamma = 27.2: {edge:.4}; Euler, gamma = 0.24: {euler:.4}");
    assert!((edge - 3.683).abs() < 0.01, "{edge}");
    assert!((euler - 3.683).abs() < 0.005, "{euler}");
    for gamma in [1.0, 2.0, 5.0] {
        let [yaw, _] = yaws("quaternion-euler", gamma);
        println!("Euler, gamma = {gamma}: {yaw:.4}");
        assert!((3.715..3.74).contains(&yaw), "gamma {gamma}: {yaw}");
    }
}

//! Table 1 of Han & Chung: the free body that spins about z, and baseline methods. See NOTATION.md on what the table prints.

use std::f64::consts::TAU;

use nalgebra::Vector6;
use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::system::State;

/// Yaw in 0..2 pi at 499.9 s and at 500 s, h = 0.1 s; `read` takes it from the simulator.
fn yaws(integrator: &str, gamma: f64, read: impl Fn(&Simulator) -> f64) -> [f64; 2] {
    let scene = Scene::shipped("free-body").unwrap();
    let options = SimulatorOptions { dt: 0.1, integrator: integrator.into(), gamma, ..SimulatorOptions::default() };
    let mut simulator = Simulator::new(scene, options).unwrap();
    simulator.set_state(0, &State { twist: Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 1.0), ..State::default() });
    [4999, 1].map(|steps| {
        simulator.step(&Inputs::default(), steps).unwrap();
        read(&simulator).rem_euclid(TAU)
    })
}

/// From the rotation: `R(Q)` of eq. 14's quaternion as it is, which is no rotation where its length is not one.
fn by_rotation(simulator: &Simulator) -> f64 {
    let r = simulator.state(0).rotation;
    r[(1, 0)].atan2(r[(0, 0)])
}

/// From the quaternion, whatever its length.
fn by_quaternion(simulator: &Simulator) -> f64 {
    let [w, _, _, z] = simulator.kept_quaternion(0).unwrap();
    2.0 * z.atan2(w)
}

#[test]
fn val_munthe_kaas_has_the_exact_yaw_at_both_instants() {
    for integrator in ["mk4", "mk3", "mk2", "mk1"] {
        let yaw = yaws(integrator, 0.0, by_rotation);
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
        let [yaw, _] = yaws("quaternion-rk4", gamma, by_quaternion);
        let [raw, _] = yaws("quaternion-rk4", gamma, by_rotation);
        println!("RK4, gamma = {gamma}: {yaw:.5} (by R(Q) as it is: {raw:.5})");
        assert!((3.52833..3.5288).contains(&yaw), "gamma {gamma}: {yaw}");
        assert!((raw - yaw).abs() < 3e-4);
    }
    let [yaw, _] = yaws("rk4-normalise", 0.0, by_rotation);
    assert!((yaw - 3.52833).abs() < 1e-5, "{yaw}");
}

#[test]
fn val_printed_yaw_of_the_baseline_appears_at_the_edge_of_stability_or_with_euler() {
    let [edge, _] = yaws("quaternion-rk4", 27.2, by_quaternion);
    let [euler, _] = yaws("quaternion-euler", 0.24, by_rotation);
    println!("RK4, gamma = 27.2: {edge:.4}; Euler, gamma = 0.24: {euler:.4}");
    assert!((edge - 3.683).abs() < 2e-3, "{edge}");
    assert!((euler - 3.683).abs() < 5e-4, "{euler}");
    for gamma in [1.0, 2.0, 5.0] {
        let [yaw, _] = yaws("quaternion-euler", gamma, by_rotation);
        println!("Euler, gamma = {gamma}: {yaw:.4}");
        assert!((3.72..3.737).contains(&yaw), "gamma {gamma}: {yaw}");
    }
}

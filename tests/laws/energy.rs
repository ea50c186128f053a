//! The energy ledger over whole motions.

use uvms_gym::balance::{Loads, Power};
use uvms_gym::batch::{Inputs, Simulator};
use uvms_gym::description::Scene;
use uvms_gym::system::State;

use crate::joints::{Sway, later};
use crate::random_scene::{Random, random_state};
use crate::simulator;

/// Simulated time, s.
const SECONDS: usize = 8;

/// Powers of all that acts on the instance now.
fn power(simulator: &Simulator, thrust: &[f64], target: &[f64]) -> Power {
    let state = simulator.state(0);
    let command: Vec<f64> = simulator
        .scene()
        .joints()
        .enumerate()
        .map(|(k, joint)| {
            let servo = joint.servo.as_ref().unwrap();
            let torque = servo.kp * (target[4 * k] - state.q[k]) + servo.kd * (target[4 * k + 1] - state.qd[k]);
            let effort = joint.effort.unwrap();
            assert!(torque.abs() < effort, "no servo saturates, which would be a kink");
            torque
        })
        .collect();
    simulator.closed_form(0).power(&Loads { thrust, external: &[], joint_command: &command }).unwrap()
}

/// Residual of the ledger, and the absolute work, J: |E(T) - E(0) - integral of power| by Boole's rule on the steps.
fn ledger(h: f64) -> (f64, f64) {
    let scene = Scene::shipped("petasus-pum").unwrap();
    let mut state = State { q: scene.home(), ..random_state(1, &scene) };
    let sway = Sway::new(&state, 5);
    sway.start(&mut state);
    let mut simulator = simulator(&scene, "mk4", h, &state);
    let steps = (1.0 / h).round() as usize;
    assert_eq!(steps % 4, 0);
    let (before, mut work, mut absolute) = (simulator.closed_form(0).energy().total(), 0.0, 0.0);
    let mut shares = [0.0; 4];
    for second in 0..SECONDS {
        let mut random = Random::new(second as u64);
        let thrust: Vec<f64> = (0..6).map(|_| random.between(-40.0, 40.0)).collect();
        let target = sway.target(second as f64);
        for step in 0..=steps {
            let now = later(&target, h * step as f64);
            let power = power(&simulator, &thrust, &now);
            let weight = match step {
                0 => 7.0,
                k if k == steps => 7.0,
                k if k % 4 == 0 => 14.0,
                k if k % 2 == 0 => 12.0,
                _ => 32.0,
            } * 2.0
                * h
                / 45.0;
            let parts = [power.drag, power.friction + power.end_stop, power.thrust, power.joint_command];
            work += weight * power.total();
            for (share, part) in shares.iter_mut().zip(parts) {
                *share += weight * part.abs();
                absolute += weight * part.abs();
            }
            if step < steps {
                let inputs = Inputs { thrust: Some(&thrust), joint_target: Some(&now), ..Inputs::default() };
                simulator.step(&inputs, 1).unwrap();
            }
        }
    }
    assert!(shares.iter().all(|&share| share > 1e-3 * absolute), "all take part: {shares:?}");
    let change = simulator.closed_form(0).energy().total() - before;
    println!(
        "h = {h}: residual {:.3e} J of {absolute:.1} J of work: {:.3e}",
        (change - work).abs(),
        (change - work).abs() / absolute
    );
    ((change - work).abs(), absolute)
}

#[test]
fn energy_is_what_the_powers_put_in() {
    let residuals = [0.01, 0.005, 0.0025].map(|h| {
        let (residual, work) = ledger(h);
        residual / work
    });
    assert!(residuals[0] < 1e-6, "{residuals:?}");
    assert!(residuals[2] < residuals[0] / 10.0, "the residual converges: {residuals:?}");
}

//! The energy ledger over whole motions.

use uvms_gym::batch::{Inputs, Simulator};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::{Loads, Power};

use super::joints::{Sway, later};
use super::simulator;
use crate::random_scene::{Random, random_state};

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
    simulator.closed_form(0, |form| {
        form.power(&Loads { thrust, external: &[], joint_command: &command, ..Loads::default() }).unwrap()
    })
}

/// Residual of the ledger by the absolute work: |E(T) - E(0) - integral of power|, by Boole's rule on the steps.
///
/// The joints sway about home without end stops; or with them, one leaning against its own.
fn ledger(h: f64, stops: bool) -> f64 {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    let mut state = random_state(1, &scene);
    let mut posture = scene.home();
    if stops {
        posture[2] -= 0.6;
        // At its own gains the effort would bound the torque beyond the stop: a kink.
        let leaning = scene.arm.as_mut().unwrap().links[2].joint.servo.as_mut().unwrap();
        (leaning.kp, leaning.kd) = (0.25 * leaning.kp, 0.5 * leaning.kd);
    } else {
        scene.arm.as_mut().unwrap().links.iter_mut().for_each(|link| link.joint.limits = None);
    }
    let sway = Sway::about(posture, 5);
    sway.start(&mut state);
    let mut simulator = simulator(&scene, "mk4", h, &state);
    let steps = (1.0 / h).round() as usize;
    assert_eq!(steps % 4, 0);
    let (before, mut work, mut absolute) = (simulator.closed_form(0, |form| form.energy().total()), 0.0, 0.0);
    let mut shares = [0.0; 5];
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
            let parts = [power.damping, power.friction, power.thrust, power.joint_command, power.end_stop];
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
    assert!(shares[..4].iter().all(|&share| share > 1e-3 * absolute), "all take part: {shares:?}");
    assert_eq!(shares[4] > 0.0, stops, "{shares:?}");
    let residual = (simulator.closed_form(0, |form| form.energy().total()) - before - work).abs() / absolute;
    println!("h = {h}, end stops {stops}: residual {residual:.3e} of {absolute:.1} J of work");
    residual
}

#[test]
fn energy_is_what_the_powers_put_in() {
    let residuals = [0.01, 0.005, 0.0025].map(|h| ledger(h, false));
    assert!(residuals[0] < 2e-7, "{residuals:?}");
    assert!(residuals[1] < residuals[0] / 8.0 && residuals[2] < residuals[1] / 8.0, "it converges: {residuals:?}");
}

/// End stops have a kink where they are met: the books close more slowly there.
#[test]
fn energy_is_what_the_powers_put_in_at_the_end_stops_too() {
    let residuals = [0.01, 0.0025].map(|h| ledger(h, true));
    assert!(residuals[0] < 5e-6, "{residuals:?}");
    assert!(residuals[1] < residuals[0] / 8.0, "it converges: {residuals:?}");
}

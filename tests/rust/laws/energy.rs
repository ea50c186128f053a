//! The energy ledger over whole motions.

use uvms_gym::batch::Inputs;
use uvms_gym::description::Scene;

use super::joints::{Sway, later};
use crate::cases::{branched, simulator_at, sprung};
use crate::random_scene::{Random, random_state};

/// Simulated time, s.
const SECONDS: usize = 8;

/// Residual of the ledger by the absolute work: |E(T) - E(0) - integral of power|, by Boole's rule on the steps.
///
/// The joints sway about home without end stops; or with them, one leaning against its own; or some are prescribed.
fn ledger(mut scene: Scene, h: f64, stops: bool, prescribed: bool) -> f64 {
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
    scene.joints_mut().enumerate().for_each(|(k, joint)| joint.prescribed = prescribed && k % 2 == 0);
    let sway = Sway::about(posture, 5);
    sway.start(&mut state);
    let mut simulator = simulator_at(&scene, "mk4", h, &state);
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
            let inputs = Inputs { thrust: Some(&thrust), joint_target: Some(&now), ..Inputs::default() };
            let loads = &simulator.applied_loads(&inputs).unwrap()[0];
            for (command, joint) in loads.joint_command.iter().zip(scene.joints()) {
                let free = joint.prescribed || command.abs() < joint.effort.unwrap();
                assert!(free, "no servo saturates, which would be a kink");
            }
            let power = simulator.closed_form(0, |form| form.power(&loads.loads())).unwrap();
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
                simulator.step(&inputs, 1).unwrap();
            }
        }
    }
    assert!(shares[..4].iter().all(|&share| share > 1e-3 * absolute), "all take part: {shares:?}");
    assert_eq!(shares[4] > 0.0, stops, "{shares:?}");
    let residual = (simulator.closed_form(0, |form| form.energy().total()) - before - work).abs() / absolute;
    println!("h = {h}, end stops {stops}, prescribed {prescribed}: residual {residual:.3e} of {absolute:.1} J of work");
    residual
}

fn petasus() -> Scene {
    Scene::shipped("petasus-pum").unwrap()
}

#[test]
fn energy_is_what_the_powers_put_in() {
    for scene in [petasus(), branched()] {
        let residuals = [0.01, 0.005, 0.0025].map(|h| ledger(scene.clone(), h, false, false));
        assert!(residuals[0] < 1e-7, "{residuals:?}");
        assert!(residuals[1] < residuals[0] / 8.0 && residuals[2] < residuals[1] / 8.0, "it converges: {residuals:?}");
    }
}

/// Springs start the joints off their targets, which the servos correct fast: at half the step.
#[test]
fn energy_is_what_the_powers_put_in_beside_springs_detents_and_static_friction() {
    let residuals = [0.005, 0.0025].map(|h| ledger(sprung(), h, false, false));
    assert!(residuals[0] < 2e-8, "{residuals:?}");
    assert!(residuals[1] < residuals[0] / 8.0, "it converges: {residuals:?}");
}

/// The drives of prescribed joints do the work that their torques say.
#[test]
fn energy_is_what_the_powers_and_the_drives_of_prescribed_joints_put_in() {
    for scene in [petasus(), branched()] {
        let residuals = [64.0, 128.0].map(|steps: f64| ledger(scene.clone(), 1.0 / steps, false, true));
        assert!(residuals[0] < 1e-6, "{residuals:?}");
        assert!(residuals[1] < residuals[0] / 8.0, "it converges: {residuals:?}");
    }
}

/// End stops have a kink where they are met: the books close more slowly there.
#[test]
fn energy_is_what_the_powers_put_in_at_the_end_stops_too() {
    let residuals = [0.01, 0.0025].map(|h| ledger(petasus(), h, true, false));
    assert!(residuals[0] < 5e-6, "{residuals:?}");
    assert!(residuals[1] < residuals[0] / 8.0, "it converges: {residuals:?}");
}

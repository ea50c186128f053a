//! Momentum without water and impulse in still water, whatever the joints do.

use nalgebra::{Vector3, Vector6};
use uvms_gym::batch::{Inputs, Simulator};
use uvms_gym::description::Scene;
use uvms_gym::system::State;

use super::joints::Sway;
use crate::cases::{branched, lossless, simulator_at, vacuum};
use crate::random_scene::Random;

/// An 11-DoF system without gravity and drag, in vacuum or in still water, and a start with momentum of both kinds.
fn floating(scene: &Scene, water: bool, prescribed: &[usize]) -> (Scene, State) {
    let mut scene = if water { lossless(scene) } else { vacuum(scene) };
    // Soft servos that overshoot; without its added mass the arm needs less gain for as much motion.
    let share = if water { 1.0 } else { 0.8 };
    for servo in scene.joints_mut().filter_map(|joint| joint.servo.as_mut()) {
        (servo.kp, servo.kd) = (0.006 * share * servo.kp, 0.04 * share * servo.kd);
    }
    scene.joints_mut().enumerate().for_each(|(k, joint)| joint.prescribed = prescribed.contains(&k));
    let mut state = State {
        position: Vector3::new(0.3, 1.0, -0.6),
        rotation: Random::new(1).rotation(),
        twist: Vector6::new(0.2, -0.1, 0.15, 0.1, -0.15, 0.2),
        q: scene.home(),
        ..State::default()
    };
    Sway::about(scene.home(), 5).start(&mut state);
    (scene, state)
}

/// Maximum drifts in a run of linear and angular momentum, relative to the sum over bodies of |momentum| at that time and at
/// the start; maximum joint rate.
struct Run {
    drift: [f64; 2],
    by_start: [f64; 2],
    rate: f64,
}

impl Run {
    fn new(scene: &Scene, water: bool, prescribed: &[usize], h: f64, seconds: usize) -> Self {
        let (scene, state) = floating(scene, water, prescribed);
        let sway = Sway::about(scene.home(), 5);
        let mut simulator = simulator_at(&scene, "mk4", h, &state);
        let books = |simulator: &Simulator| {
            let momentum = simulator.closed_form(0, |form| form.momentum());
            if water { (momentum.total(), momentum.total_scale) } else { (momentum.rigid, momentum.rigid_scale) }
        };
        let (start, start_scale) = books(&simulator);
        assert!(start.fixed_rows::<3>(0).norm() > 10.0 && start.fixed_rows::<3>(3).norm() > 1.0);
        let mut run = Self { drift: [0.0; 2], by_start: [0.0; 2], rate: 0.0 };
        for second in 0..seconds {
            let target = sway.target(second as f64);
            let inputs = Inputs { joint_target: Some(&target), ..Inputs::default() };
            simulator.step(&inputs, (1.0 / h).round() as usize).unwrap();
            let (now, scale) = books(&simulator);
            for part in 0..2 {
                let drift = (now - start).fixed_rows::<3>(3 * part).norm();
                run.drift[part] = run.drift[part].max(drift / scale[part]);
                run.by_start[part] = run.by_start[part].max(drift / start_scale[part]);
            }
            run.rate = simulator.state(0).qd.iter().fold(run.rate, |maximum, x| maximum.max(x.abs()));
        }
        assert!((simulator.state(0).twist - state.twist).norm() > 0.01, "the vehicle reacts");
        println!(
            "water {water}, h = {h}, {seconds} s: drift linear {:.2e}, angular {:.2e} (by the scale at the start {:.2e}, {:.2e}), \
             joint rates up to {:.2} rad/s",
            run.drift[0], run.drift[1], run.by_start[0], run.by_start[1], run.rate
        );
        run
    }
}

fn petasus() -> Scene {
    Scene::shipped("petasus-pum").unwrap()
}

fn is_conserved(water: bool) {
    let run = Run::new(&petasus(), water, &[], 0.01, 100);
    assert!((0.45..0.7).contains(&run.rate), "joints move near 0.5 rad/s: {}", run.rate);
    for drift in run.drift.into_iter().chain(run.by_start) {
        assert!(drift < 1e-8, "{:?} {:?}", run.drift, run.by_start);
    }
    // A shorter run, so that four steps' drifts lie above rounding.
    let runs: Vec<Run> = [0.02, 0.01, 0.005, 0.0025].map(|h| Run::new(&petasus(), water, &[], h, 20)).into();
    for part in 0..2 {
        // Least squares over equal ratios: slopes of log2, weights -3/10, -1/10, 1/10, 3/10 per halving.
        let logs: Vec<f64> = runs.iter().map(|run| run.drift[part].log2()).collect();
        let order = 0.3 * (logs[0] - logs[3]) + 0.1 * (logs[1] - logs[2]);
        println!("water {water}, part {part}: drift falls as h^{order:.3}");
        assert!(order > 3.8, "{order}");
    }
}

/// Drives are internal forces.
#[test]
fn drives_of_prescribed_joints_leave_the_momentum() {
    for scene in [petasus(), branched()] {
        let run = Run::new(&scene, true, &[0, 2, 3], 1.0 / 256.0, 3);
        let drifts = run.drift.into_iter().chain(run.by_start);
        assert!(drifts.into_iter().all(|drift| drift < 1e-9), "{:?} {:?}", run.drift, run.by_start);
    }
}

#[test]
fn momentum_of_a_tree_is_conserved_with_and_without_water() {
    for water in [false, true] {
        let runs = [0.01, 0.005].map(|h| Run::new(&branched(), water, &[], h, 20));
        for part in 0..2 {
            let [coarse, fine] = [0, 1].map(|k| runs[k].drift[part]);
            assert!(coarse < 1e-8 && fine < coarse / 8.0, "{coarse:e} {fine:e}");
        }
        assert!(runs[0].rate > 0.2);
    }
}

#[test]
fn momentum_is_conserved_without_water() {
    is_conserved(false);
}

#[test]
fn impulse_is_conserved_in_still_water_without_drag() {
    is_conserved(true);
}

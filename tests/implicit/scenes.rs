//! The shipped scenes at a step of 0.1 s.

use uvms_gym::batch::{Inputs, Precision};
use uvms_gym::description::Scene;
use uvms_gym::system::State;

use crate::random_scene::Random;
use crate::{distance, run, simulator};

/// Driven motion: station keeping, joints servoed to a target that moves, random bounded thrust held for 1 s each.
fn driven(scene: &Scene, integrator: &str, dt: f64, seconds: usize, precision: Precision) -> Vec<State> {
    let home = State { q: scene.home(), ..State::default() };
    let mut simulator = simulator(scene, integrator, dt, precision, &home);
    let mut random = Random::new(7);
    let steps = (1.0 / dt).round() as usize;
    let station: Vec<f64> = [0.3, -0.2, 0.1, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0].into();
    let mut states = Vec::new();
    let mut q = scene.home();
    for _ in 0..seconds {
        let thrust: Vec<f64> =
            scene.vehicle.thrusters.iter().map(|t| 0.3 * random.between(t.limits[0], t.limits[1])).collect();
        let mut target = Vec::new();
        for (k, joint) in scene.joints().enumerate() {
            let rate = random.between(-0.1, 0.1) - 0.1 * (q[k] - joint.home);
            target.extend([q[k], rate]);
            q[k] += rate;
        }
        let servoed = scene.joints().any(|j| j.servo.is_some());
        let inputs = Inputs {
            thrust: Some(&thrust),
            joint_target: servoed.then_some(&target),
            station: scene.vehicle.servo.is_some().then_some(&station),
            ..Inputs::default()
        };
        simulator.step(&inputs, steps).unwrap();
        states.push(simulator.state(0));
    }
    states
}

#[test]
fn every_shipped_scene_is_stable_at_a_tenth_of_a_second() {
    for name in Scene::shipped_names() {
        let scene = Scene::shipped(name).unwrap();
        let truth = driven(&scene, "mk4", 0.002, 100, Precision::Double);
        for (integrator, dt, precision) in [
            ("ros2", 0.1, Precision::Double),
            ("ros2", 0.1, Precision::Single),
            ("ros2", 0.05, Precision::Double),
            ("ros2", 0.01, Precision::Double),
            ("mk2", 0.1, Precision::Double),
            ("mk4", 0.1, Precision::Double),
        ] {
            let states = driven(&scene, integrator, dt, 100, precision);
            let errors: Vec<f64> = states.iter().zip(&truth).map(|(a, b)| distance(a, b)).collect();
            let mut sorted = errors.clone();
            sorted.sort_by(f64::total_cmp);
            println!("{name:24} {integrator} {dt} {precision:?}: median {:.2e}, max {:.2e}", sorted[50], sorted[99]);
        }
    }
    let _ = run;
    let _ = Inputs::default();
}

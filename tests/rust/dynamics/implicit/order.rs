//! Order of convergence.

use nalgebra::{Matrix6, Vector6};
use uvms_gym::batch::Inputs;
use uvms_gym::description::{Friction, Scene};
use uvms_gym::system::State;

use super::{distance, run};
use crate::random_scene::Random;

/// The arm swings free of friction and end stops, which have kinks.
fn tumbling(quadratic: bool) -> (Scene, State) {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    let arm = scene.arm.as_mut().unwrap();
    for link in &mut arm.links {
        link.joint.limits = None;
        link.joint.friction = Friction::default();
        if !quadratic {
            link.body.damping.quadratic = Matrix6::zeros();
        }
    }
    if !quadratic {
        scene.vehicle.body.damping.quadratic = Matrix6::zeros();
    }
    let mut state = State { rotation: Random::new(1).rotation(), q: scene.home(), ..State::default() };
    state.twist = Vector6::new(0.4, -0.3, 0.2, 0.9, -0.7, 0.8);
    state.qd[..5].copy_from_slice(&[0.5, -0.4, 0.6, -0.5, 0.4]);
    (scene, state)
}

/// Order of the last halving, to 1 ms, against mk4 at 1 ms.
fn order(scene: &Scene, start: &State, inputs: &Inputs) -> f64 {
    let truth = run(scene, "mk4", 1.0 / 1024.0, start, inputs, 1024);
    let error = |steps: usize| distance(&truth, &run(scene, "ros2", 1.0 / steps as f64, start, inputs, steps));
    let errors = [64, 128, 256, 512, 1024].map(error);
    let orders: Vec<f64> = errors.windows(2).map(|pair| (pair[0] / pair[1]).log2()).collect();
    println!("errors {errors:?}, orders {orders:.3?}");
    orders[3]
}

#[test]
fn the_order_is_two_on_a_tumbling_system_with_damping() {
    for quadratic in [false, true] {
        let (scene, start) = tumbling(quadratic);
        let observed = order(&scene, &start, &Inputs::default());
        assert!((observed - 2.0).abs() < 0.1, "quadratic drag {quadratic}: {observed}");
    }
}

#[test]
fn the_order_is_two_under_servos_whose_targets_move() {
    let (scene, start) = tumbling(false);
    // Cubic targets, and a station, from where both begin.
    let target: Vec<f64> = (0..5).flat_map(|k| [start.q[k], start.qd[k], 0.2, -0.3]).collect();
    let station = [0.1, 0.1, -0.1, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let inputs = Inputs { joint_target: Some(&target), pose_target: Some(&station), ..Inputs::default() };
    let observed = order(&scene, &start, &inputs);
    assert!((observed - 2.0).abs() < 0.1, "{observed}");
}

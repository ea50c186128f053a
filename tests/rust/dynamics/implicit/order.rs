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

/// Orders of the methods by the last halving, to 1 ms, against mk4 at 0.5 ms.
fn check_orders(scene: &Scene, start: &State, inputs: &Inputs) {
    let truth = run(scene, "mk4", 1.0 / 2048.0, start, inputs, 2048);
    for (integrator, order) in [("ros2", 2.0), ("ros3", 3.0)] {
        let error = |steps: usize| distance(&truth, &run(scene, integrator, 1.0 / steps as f64, start, inputs, steps));
        let errors = [128, 256, 512, 1024].map(error);
        let orders: Vec<f64> = errors.windows(2).map(|pair| (pair[0] / pair[1]).log2()).collect();
        println!("{integrator}: errors {errors:?}, orders {orders:.3?}");
        assert!(orders[2] > order - 0.1 * (order - 1.0) && orders[2] < order + 1.0, "{integrator}: {orders:?}");
    }
}

#[test]
fn the_orders_are_two_and_three_on_a_tumbling_system_with_damping() {
    for quadratic in [false, true] {
        let (scene, start) = tumbling(quadratic);
        println!("quadratic drag {quadratic}");
        check_orders(&scene, &start, &Inputs::default());
    }
}

#[test]
fn the_orders_are_two_and_three_under_servos_whose_targets_move() {
    let (scene, start) = tumbling(false);
    // Cubic targets, and a station, from where both begin.
    let target: Vec<f64> = (0..5).flat_map(|k| [start.q[k], start.qd[k], 0.2, -0.3]).collect();
    let station = [0.1, 0.1, -0.1, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let inputs = Inputs { joint_target: Some(&target), pose_target: Some(&station), ..Inputs::default() };
    check_orders(&scene, &start, &inputs);
}

//! Order of convergence.

use uvms_gym::batch::Inputs;
use uvms_gym::description::Scene;
use uvms_gym::system::State;

use crate::cases::{distance, orders, run, tumbling};

/// Orders of the methods by the last halving, to 1 ms, against mk4 at 0.5 ms.
fn check_orders(scene: &Scene, start: &State, inputs: &Inputs) {
    let truth = run(scene, "mk4", 1.0 / 2048.0, start, inputs, 2048);
    for (integrator, order) in [("ros2", 2.0), ("ros3", 3.0)] {
        let error = |steps: usize| distance(&truth, &run(scene, integrator, 1.0 / steps as f64, start, inputs, steps));
        let errors = [128, 256, 512, 1024].map(error);
        let orders = orders(&errors);
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

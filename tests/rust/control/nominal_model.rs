//! Predictions of the nominal model.

use uvms_gym::control::{AppliedWrenches, ArmState, NominalModel, VehicleMotion};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::aba::Scratch;
use uvms_gym::lie::Vector6;
use uvms_gym::system::JOINTS;

#[test]
fn a_prediction_of_fast_motion_is_near_that_of_small_steps() {
    for (name, speeds, tolerance) in [("bluerov2-heavy", [1.0, 5.0], 0.05), ("petasus-pum", [0.5, 1.0], 0.05)] {
        let scene = Scene::shipped(name).unwrap();
        let (model, mut scratch) = (NominalModel::new(&scene), Scratch::new());
        let still = ArmState { q: scene.home(), qd: [0.0; JOINTS] };
        for k in 0..6 {
            let speed = speeds[k / 3];
            let twist = Vector6::from_array(std::array::from_fn(|i| if i == k { speed } else { 0.0 }));
            let (six, start) = (Vector6::zero(), VehicleMotion { error: Vector6::zero(), twist });
            let wrenches = AppliedWrenches { command: six, thrust: six, disturbance: six };
            let at_once = model.predict(&start, [&still; 2], &wrenches, 0.1, &mut scratch).motion;
            let mut fine = start;
            for _ in 0..100 {
                fine = model.predict(&fine, [&still; 2], &wrenches, 0.001, &mut scratch).motion;
            }
            let miss = at_once.twist - fine.twist;
            let norm = miss.dot(miss).sqrt();
            assert!(norm < tolerance * speed, "{name}, axis {k}: {norm}");
        }
    }
}

//! Controllers and thruster allocation.

mod actions;
mod equations;
mod mlp;
mod mpc;
mod nmpc;
mod nominal_model;
mod resolved_motion;
mod righting;
mod thruster_fault;

use uvms_gym::control::{ActionKind, ActionMap, Actuated, Actuation, Allocation, BlockIndices, TrackingIndices};
use uvms_gym::description::Scene;

/// Torques of the joints of petasus-pum.
const JOINT_TORQUES: [f64; 5] = [14.0, 21.0, 4.0, 0.9, 0.06];

/// Wrench actions of a scene, and these torques.
fn actions(scene: &Scene, torques: &[f64]) -> ActionMap {
    ActionMap::new(ActionKind::Wrench, Allocation::new(&scene.vehicle).unwrap(), torques.to_vec())
}

/// Thrusts and torques of an action.
fn actuated(map: &ActionMap, action: &[f32]) -> Actuated<f64> {
    Actuation::new(map).act_on_row(action)
}

/// Entries of an observation with one scale.
fn block(offset: usize, count: usize, scale: f64) -> BlockIndices {
    BlockIndices { offset, scale: vec![scale; count] }
}

/// An observation of petasus-pum in SI units, without a preview.
fn tracking_indices() -> TrackingIndices {
    let [error, twist, up, q, qd, reference] =
        [(0, 6), (6, 6), (12, 3), (15, 5), (20, 5), (25, 6)].map(|(offset, count)| block(offset, count, 1.0));
    TrackingIndices { width: 31, error, twist, up, q, qd, reference, ahead: None }
}

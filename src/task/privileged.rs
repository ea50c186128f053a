//! Privileged information beyond an observation, for critics in training.

use super::pose::Pose;
use crate::system::{FACTORS, Factors, Flow, State};

/// Names and lengths of the parts of [`privileged`], for `joints` joints.
pub fn privileged_layout(joints: usize) -> [(&'static str, usize); 10] {
    [
        ("position", 3),
        ("rotation", 9),
        ("twist", 6),
        ("q", joints),
        ("qd", joints),
        ("current", 3),
        ("current_acceleration", 3),
        ("parameters", FACTORS),
        ("target_position", 3),
        ("target_rotation", 9),
    ]
}

/// True state, flow, parameters and target of an instance with `joints` joints, in SI units and world axes (the twist in
/// body axes), rotations by rows.
pub fn privileged(joints: usize, state: &State, flow: &Flow, factors: &Factors<f64>, target: &Pose) -> Vec<f64> {
    let rotations = [state.rotation, target.rotation].map(|rotation| rotation.transpose());
    [
        state.position.as_slice(),
        rotations[0].as_slice(),
        state.twist.as_slice(),
        &state.q[..joints],
        &state.qd[..joints],
        flow.velocity.as_slice(),
        flow.acceleration.as_slice(),
        &factors.to_array(),
        target.position.as_slice(),
        rotations[1].as_slice(),
    ]
    .concat()
}

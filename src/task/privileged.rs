//! Privileged information beyond an observation, for critics in training.

use super::pose::Pose;
use crate::system::{FACTORS, Factors, Flow, State};

/// Named part of a row of [`privileged`].
pub struct PrivilegedPart {
    /// Name, as in `privileged_layout`.
    pub name: &'static str,
    /// Number of entries.
    pub length: usize,
    /// Unit of the entries.
    pub unit: &'static str,
    /// Meaning and axes.
    pub description: &'static str,
}

/// Parts of [`privileged`] in order, for `joints` joint coordinates, those of fixtures included.
pub fn privileged_layout(joints: usize) -> [PrivilegedPart; 10] {
    let part = |name, length, unit, description| PrivilegedPart { name, length, unit, description };
    [
        part("position", 3, "m", "vehicle origin, world axes"),
        part("rotation", 9, "1", "rotation matrix by rows, body to world"),
        part("twist", 6, "m/s and rad/s", "absolute twist [v; omega], body axes"),
        part("q", joints, "rad or m", "joint coordinates"),
        part("qd", joints, "rad/s or m/s", "joint rates"),
        part("current", 3, "m/s", "velocity of the water, world axes"),
        part("current_acceleration", 3, "m/s^2", "acceleration of the water, world axes"),
        part("parameters", FACTORS, "1 and kg", "factors on the scene's parameters, and the payload"),
        part("target_position", 3, "m", "target, world axes"),
        part("target_rotation", 9, "1", "target's rotation matrix by rows, to world axes"),
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

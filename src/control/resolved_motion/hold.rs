//! End effectors that are held still in the world.

use nalgebra as na;

use super::reading::TrackingState;
use crate::control::nominal_model::NominalModel;
use crate::lie::{Matrix3, Pose, Vector3, Vector6, exp_se3, rotation_vector};

/// Maximum number of end effectors that are held.
pub(super) const MAX_HELD: usize = 3;

/// Numbers of memory of a pose.
const POSE: usize = 12;

/// Numbers of memory: the reference's last twist, and the target of each held end effector.
pub(super) fn memory(held: usize) -> [usize; 2] {
    if held == 0 { [0; 2] } else { [6, POSE * held] }
}

/// Targets of the held end effectors, relative to the reference: their poses when the episode begins.
///
/// Observations have no pose in the world, but the pose relative to the reference, and the reference's twist xi. A target D, fixed
/// in the world, therefore moves by `D := exp(-T xi) D` in each control period T, with the mean twist of its start and end.
pub(super) fn targets(model: &NominalModel, now: &TrackingState, period: f64, memory: &mut [f64]) -> Vec<Pose<f64>> {
    if memory.is_empty() {
        return Vec::new();
    }
    let turn = exp_se3(Vector6 { linear: Vector3::zero(), angular: pair(&now.error).angular }).rotation;
    let Vector6 { linear, angular } = pair(&now.reference);
    let twist = Vector6 { linear: turn.apply(linear), angular: turn.apply(angular) };
    let (last, stored) = memory.split_at_mut(6);
    let mean = (twist + Vector6::from_array(std::array::from_fn(|k| last[k]))).scale(0.5);
    let motion = exp_se3(mean.scale(-period));
    last.copy_from_slice(&twist.to_array());
    let poses = poses(model, now).into_iter().zip(stored.chunks_exact_mut(POSE));
    poses
        .map(|(pose, stored)| {
            // No rotation matrix is 0.
            let begins = stored[..9].iter().all(|entry| *entry == 0.0);
            let target = if begins { pose } else { motion.times(&read(stored)) };
            stored[..9].copy_from_slice(target.rotation.0.as_flattened());
            stored[9..].copy_from_slice(&target.position.0);
            target
        })
        .collect()
}

/// Errors `[R^T (r - r_d); log(R_d^T R)]` of the held end effectors.
pub(super) fn errors(model: &NominalModel, now: &TrackingState, targets: &[Pose<f64>]) -> Vec<na::Vector6<f64>> {
    let error = |(pose, target): (Pose<f64>, &Pose<f64>)| {
        let linear = pose.rotation.apply_transposed(pose.position - target.position);
        let angular = rotation_vector(&target.rotation.transposed().times(&pose.rotation));
        na::Vector6::from(Vector6 { linear, angular }.to_array())
    };
    poses(model, now).into_iter().zip(targets).map(error).collect()
}

/// Poses of the held end effectors relative to the reference.
fn poses(model: &NominalModel, now: &TrackingState) -> Vec<Pose<f64>> {
    if model.held.is_empty() {
        return Vec::new();
    }
    let Vector6 { linear, angular } = pair(&now.error);
    let turn = exp_se3(Vector6 { linear: Vector3::zero(), angular }).rotation;
    let tracking = Pose { rotation: turn, position: turn.apply(linear) };
    let tip = model.end_effector.at(&now.q);
    let pose = |held: Pose<f64>| {
        let rotation = tip.rotation.transposed().times(&held.rotation);
        tracking.times(&Pose { rotation, position: tip.rotation.apply_transposed(held.position - tip.position) })
    };
    model.held.iter().map(|held| pose(held.at(&now.q))).collect()
}

fn pair(six: &na::Vector6<f64>) -> Vector6<f64> {
    Vector6::from_array((*six).into())
}

/// A pose from memory.
fn read(stored: &[f64]) -> Pose<f64> {
    let row = |i: usize| std::array::from_fn(|k| stored[3 * i + k]);
    Pose { rotation: Matrix3([row(0), row(1), row(2)]), position: Vector3([stored[9], stored[10], stored[11]]) }
}

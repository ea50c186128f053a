//! The scene as a task reads it.

use nalgebra::Vector3;

use super::disturbance::{Disturbance, DisturbanceContext};
use super::drives::JointDrives;
use super::observation::ObservationLayout;
use super::pose::Pose;
use super::scene_draws::SceneDraws;
use crate::control::ActionMap;
use crate::description::{Joint, Scene};
use crate::system::{EndEffector, Joints, State};

/// A scene with its actuators, its disturbances and the layout of an observation.
#[derive(Debug, Clone)]
pub struct TaskModel {
    /// The scene, with the task's changes.
    pub scene: Scene,
    /// Its joints.
    pub joints: Vec<Joint>,
    /// Home coordinates of the joints.
    pub home: Joints,
    /// End effector in the vehicle's frame.
    pub end_effector: EndEffector,
    /// Meaning of an action.
    pub actions: ActionMap,
    /// Limits of driven joints; none where the joints follow references.
    pub drives: JointDrives,
    /// Orthonormal, world axes: two horizontal ones and the one against gravity (world z without gravity).
    pub level: [Vector3<f64>; 3],
    /// Disturbance of the episodes.
    pub disturbance: Disturbance,
    /// Scenes of the episodes, where they differ.
    pub scene_draws: Option<SceneDraws>,
    /// Constants of the scene for disturbances.
    pub context: DisturbanceContext,
    /// Entries of an observation.
    pub layout: ObservationLayout,
}

impl TaskModel {
    /// World axis against gravity (world z without gravity).
    pub fn up(&self) -> [f64; 3] {
        self.level[2].into()
    }

    /// Pose of the end effector of a vehicle at that pose.
    pub fn end_effector_pose(&self, vehicle: &Pose, q: &Joints) -> Pose {
        let (rotation, position) = self.end_effector.pose(q);
        Pose { position: vehicle.position + vehicle.rotation * position, rotation: vehicle.rotation * rotation }
    }

    /// Pose of the end effector in a state.
    pub fn end_effector_of(&self, state: &State) -> Pose {
        self.end_effector_pose(&Pose::of_vehicle(state), &state.q)
    }
}

//! Poses, twists and Jacobians of a scene at a state.

use nalgebra::{Matrix6xX, Vector6};

use super::closed_form::ClosedForm;
use super::closed_form_model::BodyFrame;
use super::dense::DensePose;

impl ClosedForm<'_> {
    /// Poses of the moving bodies in the world, vehicle first.
    pub fn body_poses(&self) -> Vec<DensePose> {
        self.moving.iter().map(|&k| self.world_pose(k)).collect()
    }

    /// Poses of the fixtures in the world.
    pub fn fixture_poses(&self) -> Vec<DensePose> {
        self.fixtures.iter().map(|form| form.world_pose(2)).collect()
    }

    /// Absolute body twists of the moving bodies, vehicle first, m/s and rad/s.
    pub fn body_twists(&self) -> Vec<Vector6<f64>> {
        self.moving.iter().map(|&k| self.equations.bodies[k].twist).collect()
    }

    /// Pose in the world of a frame on a body.
    pub fn pose_of(&self, (carrier, frame): BodyFrame) -> DensePose {
        self.world_pose(carrier) * frame
    }

    /// Body twist of a frame on a body per `[V; q']`, (6, 6+n). `[MLS94]`
    pub fn jacobian_of(&self, (carrier, frame): BodyFrame) -> Matrix6xX<f64> {
        frame.adjoint_inverse() * self.equations.body_jacobian(carrier)
    }

    /// Pose of the end effector in use in the world; the vehicle's pose without an arm.
    pub fn end_effector_pose(&self) -> DensePose {
        self.pose_of(self.model.end_effector)
    }

    /// Jacobian of the end effector in use.
    pub fn jacobian(&self) -> Matrix6xX<f64> {
        self.jacobian_of(self.model.end_effector)
    }
}

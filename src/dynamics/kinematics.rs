//! Poses, twists and Jacobians of a scene at a state.

use nalgebra::{Matrix6xX, Vector6};

use super::closed_form::ClosedForm;
use super::dense::DensePose;

impl ClosedForm<'_> {
    /// Poses of the moving bodies in the world, vehicle first.
    pub fn body_poses(&self) -> Vec<DensePose> {
        self.moving.iter().map(|&k| self.world_pose(k)).collect()
    }

    /// Absolute body twists of the moving bodies, vehicle first, m/s and rad/s.
    pub fn body_twists(&self) -> Vec<Vector6<f64>> {
        self.moving.iter().map(|&k| self.equations.bodies[k].twist).collect()
    }

    /// Pose of the end effector in the world: on the last link, else on the arm's base, else the vehicle's pose.
    pub fn end_effector_pose(&self) -> DensePose {
        let (carrier, end_effector) = self.model.end_effector;
        self.world_pose(carrier) * end_effector
    }

    /// End-effector body twist per `[V; q']`, (6, 6+n). `[MLS94]`
    pub fn jacobian(&self) -> Matrix6xX<f64> {
        let (carrier, end_effector) = self.model.end_effector;
        end_effector.adjoint_inverse() * self.equations.body_jacobian(carrier)
    }
}

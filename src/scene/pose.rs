//! Poses of rigid frames in the world, and how far apart they are.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::system::State;

/// A frame in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Origin, m.
    pub position: Vector3<f64>,
    /// Frame to world rotation.
    pub rotation: Matrix3<f64>,
}

impl Default for Pose {
    fn default() -> Self {
        Self { position: Vector3::zeros(), rotation: Matrix3::identity() }
    }
}

impl Pose {
    /// The vehicle's pose.
    pub fn of_vehicle(state: &State) -> Self {
        Self { position: state.position, rotation: state.rotation }
    }

    /// Error of this pose with respect to `target`: what has to shrink to zero, in this frame's axes.
    pub fn error_from(&self, target: &Self) -> PoseError {
        PoseError {
            position: self.rotation.tr_mul(&(self.position - target.position)),
            rotation: rotation_vector(&target.rotation.tr_mul(&self.rotation)),
        }
    }
}

/// Error of a pose with respect to a target pose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoseError {
    /// `R^T (r - r_d)`, body axes, m.
    pub position: Vector3<f64>,
    /// `log(R_d^T R)`, the same in body and in target axes, rad, at most pi long.
    pub rotation: Vector3<f64>,
}

/// Rotation vector `log R`, at most pi long. By way of the quaternion, whose largest entry is found first: exact near
/// 0 and near pi alike, where the trace and the skew part lose their digits.
pub fn rotation_vector(rotation: &Matrix3<f64>) -> Vector3<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation)).scaled_axis()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use proptest::prelude::*;

    use super::*;

    fn turn(vector: Vector3<f64>) -> Matrix3<f64> {
        Rotation3::from_scaled_axis(vector).into_inner()
    }

    proptest! {
        #[test]
        fn rotation_vector_inverts_rotation(x in -1.0..1.0f64, y in -1.0..1.0f64, z in -1.0..1.0f64, exponent in -12.0..0.0f64) {
            let direction = Vector3::new(x, y, z);
            prop_assume!(direction.norm() > 1e-3);
            let axis = direction.normalize();
            // Both ends of [0, pi] on a logarithmic scale.
            for angle in [PI * 10f64.powf(exponent), PI * (1.0 - 10f64.powf(exponent))] {
                let back = rotation_vector(&turn(axis * angle));
                // At pi the two signs are the same rotation.
                let miss = (back - axis * angle).norm().min((back + axis * (2.0 * PI - angle)).norm());
                prop_assert!(miss < 1e-14 + 1e-14 * angle, "angle {angle}: {miss}");
            }
        }
    }

    #[test]
    fn rotation_vector_holds_its_digits_at_tiny_angles() {
        let vector = Vector3::new(3e-10, -2e-10, 1e-10);
        assert!((rotation_vector(&turn(vector)) - vector).norm() < 1e-24);
        assert_eq!(rotation_vector(&Matrix3::identity()), Vector3::zeros());
    }

    #[test]
    fn half_turns_are_pi_long() {
        for axis in [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::new(0.6, 0.0, -0.8)] {
            let half = 2.0 * axis * axis.transpose() - Matrix3::identity();
            let vector = rotation_vector(&half);
            assert!((vector.norm() - PI).abs() < 1e-15);
            assert!(vector.cross(&axis).norm() < 1e-15);
        }
    }

    #[test]
    fn error_of_a_pose_is_seen_from_its_own_axes() {
        let target = Pose { position: Vector3::new(1.0, 2.0, 3.0), rotation: turn(Vector3::new(0.3, -0.2, 0.9)) };
        let pose = Pose {
            position: target.position + target.rotation * turn(Vector3::z() * 0.1) * Vector3::new(0.5, 0.0, 0.0),
            rotation: target.rotation * turn(Vector3::z() * 0.1),
        };
        let error = pose.error_from(&target);
        assert!((error.position - Vector3::new(0.5, 0.0, 0.0)).norm() < 1e-15);
        assert!((error.rotation - Vector3::new(0.0, 0.0, 0.1)).norm() < 1e-15);
    }
}

//! Compliance: the end effector gives way to the force on it.

use nalgebra::{Matrix3, Vector3, Vector6};

use crate::control::equations::{Equations, Velocities};

/// Damping of the least squares, m2.
const DAMPING: f64 = 1e-3;

/// Displacement of the end effector, in its axes, by the force on it that explains the disturbance of the joints' torques best: the
/// disturbance of the vehicle is not used, as water moves the vehicle more than the arm.
pub(super) fn displacement(
    compliance: f64,
    equations: &Equations,
    disturbance: &Velocities,
    joints: usize,
) -> Vector6<f64> {
    let mut displacement = Vector6::zeros();
    if compliance > 0.0 && joints > 0 {
        // d = J^T F of the linear rows.
        let (mut square, mut moment) = (Matrix3::identity() * DAMPING, Vector3::zeros());
        for k in 6..6 + joints {
            let column: Vector3<f64> = equations.jacobian.fixed_view::<3, 1>(0, k).into_owned();
            square += column * column.transpose();
            moment += column * disturbance[k];
        }
        let force = square.cholesky().map_or_else(Vector3::zeros, |factor| factor.solve(&moment));
        displacement.fixed_rows_mut::<3>(0).copy_from(&(force * compliance));
    }
    displacement
}

//! Local coordinates of states and pose errors, with their derivatives.

use nalgebra as na;

use crate::lie::{DexpInverse, Matrix3, Vector3, Vector6, dexp_inverse_negative, rotation_vector};
use crate::system::State;

fn logarithm(rotation: &na::Matrix3<f64>) -> na::Vector3<f64> {
    rotation_vector(&Matrix3([0, 1, 2].map(|i| [0, 1, 2].map(|k| rotation[(i, k)])))).0.into()
}

/// Inverse of the right Jacobian of SO(3) at `phi`, applied to `x`.
fn right_jacobian_inverse(phi: &na::Vector3<f64>, x: &na::Vector3<f64>) -> na::Vector3<f64> {
    let turn = |v: &na::Vector3<f64>| Vector6 { linear: Vector3([0.0; 3]), angular: Vector3((*v).into()) };
    dexp_inverse_negative(DexpInverse::Closed, turn(phi), turn(x)).angular.0.into()
}

/// `[xi; dq; dV; dq'; dT]` from one state to another: the pose of the other is `T exp(xi)`.
pub fn difference(from: &State, to: &State, joints: usize, thrusters: usize) -> na::DVector<f64> {
    let angular = logarithm(&(from.rotation.tr_mul(&to.rotation)));
    let linear = right_jacobian_inverse(&-angular, &from.rotation.tr_mul(&(to.position - from.position)));
    let mut all = Vec::with_capacity(12 + 2 * joints + thrusters);
    all.extend(linear.iter().chain(angular.iter()));
    let mut difference = |a: &[f64], b: &[f64]| all.extend(a.iter().zip(b).map(|(a, b)| a - b));
    difference(&to.q[..joints], &from.q[..joints]);
    difference(to.twist.as_slice(), from.twist.as_slice());
    difference(&to.qd[..joints], &from.qd[..joints]);
    difference(&to.thrust[..thrusters], &from.thrust[..thrusters]);
    na::DVector::from_vec(all)
}

/// Pose error `[R^T (r - r_d); log(R_d^T R)]`.
pub fn pose_error(state: &State, position: &na::Vector3<f64>, rotation: &na::Matrix3<f64>) -> na::Vector6<f64> {
    let linear = state.rotation.tr_mul(&(state.position - position));
    let angular = logarithm(&rotation.tr_mul(&state.rotation));
    na::Vector6::from_iterator(linear.iter().chain(angular.iter()).copied())
}

/// Derivative of [`pose_error`] by xi, at an error.
pub fn pose_error_jacobian(error: &na::Vector6<f64>) -> na::Matrix6<f64> {
    let (linear, angular) = (error.fixed_rows::<3>(0).into_owned(), error.fixed_rows::<3>(3).into_owned());
    let mut jacobian = na::Matrix6::identity();
    jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&linear.cross_matrix());
    for k in 0..3 {
        let column = right_jacobian_inverse(&angular, &na::Vector3::ith(k, 1.0));
        jacobian.fixed_view_mut::<3, 1>(3, 3 + k).copy_from(&column);
    }
    jacobian
}

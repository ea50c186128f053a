//! Quadratic costs of tracking and their quadratic models, of Gauss and Newton.

use nalgebra as na;

use super::tangent::{pose_error, pose_error_jacobian};
use crate::lane::Dual;
use crate::system::{EndEffector, JOINTS, State};

/// Numbers of a reference, without the joints: position, rotation by rows, twist, end effector.
const REFERENCE: usize = 21;
/// Residuals, without the joints: pose error, twist, end effector.
const RESIDUALS: usize = 15;

/// Numbers of a reference of a state: position (3), m; rotation by rows (9); q (n); twist (6); q' (n); position of the end
/// effector in the world (3), m.
pub fn reference_width(joints: usize) -> usize {
    REFERENCE + 2 * joints
}

/// Numbers of the weights of a state: on pose error (6), q (n), twist (6), q' (n) and end effector (3).
pub fn residuals(joints: usize) -> usize {
    RESIDUALS + 2 * joints
}

/// Half the weighted sum of squared differences between a state and its reference.
pub struct StateCost<'a> {
    pub end_effector: &'a EndEffector,
    pub joints: usize,
    pub thrusters: usize,
}

impl StateCost<'_> {
    /// World position of the end effector.
    pub fn end_effector_position(&self, state: &State) -> na::Vector3<f64> {
        state.position + state.rotation * self.end_effector.pose(&state.q).1
    }

    /// Differences in the order of the weights.
    fn differences(&self, state: &State, reference: &[f64]) -> na::DVector<f64> {
        let n = self.joints;
        let rotation = na::Matrix3::from_row_slice(&reference[3..12]);
        let error = pose_error(state, &na::Vector3::from_column_slice(&reference[..3]), &rotation);
        let end = self.end_effector_position(state);
        let values = state.q[..n].iter().chain(&state.twist).chain(&state.qd[..n]).chain(&end);
        let rest = values.zip(&reference[12..]).map(|(x, d)| x - d);
        na::DVector::from_iterator(residuals(n), error.iter().copied().chain(rest))
    }

    /// The cost.
    pub fn value(&self, state: &State, reference: &[f64], weights: &[f64]) -> f64 {
        self.differences(state, reference).iter().zip(weights).map(|(e, w)| 0.5 * w * e * e).sum()
    }

    /// Gradient and Hessian of Gauss and Newton, in the coordinates of the steps' Jacobians.
    pub fn expand(&self, state: &State, reference: &[f64], weights: &[f64]) -> (na::DVector<f64>, na::DMatrix<f64>) {
        let n = self.joints;
        let (errors, s) = (self.differences(state, reference), 12 + 2 * n);
        let (mut gradient, mut hessian) =
            (na::DVector::zeros(s + self.thrusters), na::DMatrix::zeros(s + self.thrusters, s + self.thrusters));
        let error = errors.fixed_rows::<6>(0).into_owned();
        let pose = pose_error_jacobian(&error);
        let weighted = na::Matrix6::from_diagonal(&na::Vector6::from_column_slice(&weights[..6])) * pose;
        gradient.fixed_rows_mut::<6>(0).copy_from(&weighted.tr_mul(&error));
        hessian.fixed_view_mut::<6, 6>(0, 0).copy_from(&pose.tr_mul(&weighted));
        for k in 6..s {
            gradient[k] = weights[k] * errors[k];
            hessian[(k, k)] = weights[k];
        }
        if weights[s..].iter().any(|w| *w > 0.0) {
            let mut rows = na::Matrix3xX::zeros(6 + n);
            let turn = -state.rotation * self.end_effector.pose(&state.q).1.cross_matrix();
            rows.fixed_columns_mut::<3>(0).copy_from(&state.rotation);
            rows.fixed_columns_mut::<3>(3).copy_from(&turn);
            for k in 0..n {
                rows.set_column(6 + k, &(state.rotation * self.end_effector_rate(state, k)));
            }
            let weighted = na::Matrix3::from_diagonal(&na::Vector3::from_column_slice(&weights[s..])) * &rows;
            let (mut by_pose, mut of_pose) = (gradient.rows_mut(0, 6 + n), hessian.view_mut((0, 0), (6 + n, 6 + n)));
            by_pose += weighted.tr_mul(&errors.fixed_rows::<3>(s));
            of_pose += rows.tr_mul(&weighted);
        }
        (gradient, hessian)
    }

    /// Derivative of the end effector's position in the vehicle frame by joint k.
    fn end_effector_rate(&self, state: &State, k: usize) -> na::Vector3<f64> {
        let q: [Dual; JOINTS] = std::array::from_fn(|i| Dual::new(state.q[i], f64::from(u8::from(i == k))));
        self.end_effector.at(&q).position.0.map(|x| x.slope).into()
    }
}

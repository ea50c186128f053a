//! Backward pass: the optimal change of the inputs and its feedback, from the last knot to the first.

use nalgebra::{DMatrix, DVector};

use super::box_qp::minimise;
use crate::limits::interrupt;

/// Quadratic model about a knot in `z = [dx; du]`: next state `dynamics z`, cost `gradient^T z + z^T hessian z / 2`.
#[derive(Debug, Clone, PartialEq)]
pub struct Knot {
    /// Derivative of the next state.
    pub dynamics: DMatrix<f64>,
    /// Gradient of the cost.
    pub gradient: DVector<f64>,
    /// Hessian of the cost.
    pub hessian: DMatrix<f64>,
}

/// Quadratic model about a trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct Expansion {
    /// Models about the knots.
    pub knots: Vec<Knot>,
    /// Gradient and Hessian of the cost of the last state.
    pub end: (DVector<f64>, DMatrix<f64>),
}

/// Minimum and maximum change of the inputs of each knot.
pub type Ranges = Vec<[DVector<f64>; 2]>;

/// Change of a knot's inputs: `feedforward + gain dx`.
#[derive(Debug, Clone, PartialEq)]
pub struct Policy {
    /// Change without a deviation of the state.
    pub feedforward: DVector<f64>,
    /// Change per deviation of the state.
    pub gain: DMatrix<f64>,
}

/// Policies of all knots.
pub struct Pass {
    pub policies: Vec<Policy>,
    /// Change of the cost expected of a step of size a: `a slope + a^2 curvature / 2`.
    pub slope: f64,
    pub curvature: f64,
}

/// Policies that minimise the model within the ranges, with the diagonal of the inputs' Hessian times `1 + damping`: Levenberg's
/// and Marquardt's. None where that Hessian is not positive definite, and at an interrupt. `[TET12, TMT14]`
pub fn backward(model: &Expansion, ranges: &Ranges, damping: f64) -> Option<Pass> {
    let (mut v, mut value) = model.end.clone();
    let (mut slope, mut curvature) = (0.0, 0.0);
    let states = v.len();
    let mut policies = Vec::with_capacity(model.knots.len());
    for (knot, [lower, upper]) in model.knots.iter().zip(ranges).rev() {
        if interrupt::requested() {
            return None;
        }
        // Products of transposes are several times as fast as `tr_mul`.
        let transposed = knot.dynamics.transpose();
        let q = &knot.gradient + &transposed * &v;
        let hessian = &knot.hessian + transposed * (&value * &knot.dynamics);
        let inputs = q.len() - states;
        let (q_x, q_u) = (q.rows(0, states), q.rows(states, inputs).into_owned());
        let (q_xx, q_ux) = (hessian.view((0, 0), (states, states)), hessian.view((states, 0), (inputs, states)));
        let q_uu = hessian.view((states, states), (inputs, inputs)).into_owned();
        let mut damped = q_uu.clone();
        (0..inputs).for_each(|k| damped[(k, k)] *= 1.0 + damping);
        let minimum = minimise(&damped, &q_u, lower, upper)?;
        let mut gain = DMatrix::zeros(inputs, states);
        let rows = minimum.factor.solve(&q_ux.select_rows(&minimum.free));
        for (row, k) in minimum.free.iter().enumerate() {
            gain.row_mut(*k).copy_from(&-rows.row(row));
        }
        let feedforward = minimum.x;
        let curve = &q_uu * &feedforward;
        slope += feedforward.dot(&q_u);
        curvature += feedforward.dot(&curve);
        v = q_x + gain.tr_mul(&(&curve + &q_u)) + q_ux.tr_mul(&feedforward);
        let full = q_xx + gain.transpose() * (&q_uu * &gain + q_ux) + q_ux.transpose() * &gain;
        value = (&full + full.transpose()) * 0.5;
        policies.push(Policy { feedforward, gain });
    }
    policies.reverse();
    Some(Pass { policies, slope, curvature })
}

//! Condensing: the quadratic model of a trajectory in the inputs alone.

use nalgebra::{DMatrix, DVector};

use super::backward::Expansion;

/// Hessian and gradient of the model's cost by the changes of all inputs, knot by knot, from a given first state. `[Boc84]`
pub fn condensed(model: &Expansion) -> (DMatrix<f64>, DVector<f64>) {
    let (mut adjoint, mut ahead) = model.end.clone();
    let states = adjoint.len();
    let inputs = model.knots.first().map_or(0, |knot| knot.gradient.len() - states);
    let count = model.knots.len();
    let mut hessian = DMatrix::zeros(count * inputs, count * inputs);
    let mut gradient = DVector::zeros(count * inputs);
    // Mixed derivatives of the cost from each knot on, by its inputs and its state.
    let mut mixed = vec![DMatrix::zeros(0, 0); count];
    for (k, knot) in model.knots.iter().enumerate().rev() {
        let transposed = knot.dynamics.transpose();
        let by_z = &knot.gradient + &transposed * &adjoint;
        let full = &knot.hessian + transposed * (&ahead * &knot.dynamics);
        hessian
            .view_mut((k * inputs, k * inputs), (inputs, inputs))
            .copy_from(&full.view((states, states), (inputs, inputs)));
        gradient.rows_mut(k * inputs, inputs).copy_from(&by_z.rows(states, inputs));
        mixed[k] = full.view((states, 0), (inputs, states)).into_owned();
        (adjoint, ahead) = (by_z.rows(0, states).into_owned(), full.view((0, 0), (states, states)).into_owned());
    }
    for (from, knot) in model.knots.iter().enumerate() {
        let mut reached = knot.dynamics.columns(states, inputs).into_owned();
        for to in from + 1..count {
            let block = &mixed[to] * &reached;
            hessian.view_mut((from * inputs, to * inputs), (inputs, inputs)).copy_from(&block.transpose());
            hessian.view_mut((to * inputs, from * inputs), (inputs, inputs)).copy_from(&block);
            reached = model.knots[to].dynamics.columns(0, states) * reached;
        }
    }
    (hessian, gradient)
}

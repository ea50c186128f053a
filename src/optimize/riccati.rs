//! Cost of linear feedback without limits, by its Riccati recursion.

use nalgebra::DMatrix;

/// Step of the recursion at which it ends, over its maximum entry.
const SETTLED: f64 = 1e-9;
/// Maximum number of its steps.
const STEPS: usize = 400;

/// Hessian, by the state, of the cost of optimal linear feedback of `x' = dynamics z` from a state on, with `z = [x; u]` and the
/// cost `z^T hessian z / 2` of each step.
pub fn cost_to_go(hessian: &DMatrix<f64>, dynamics: &DMatrix<f64>) -> DMatrix<f64> {
    let states = dynamics.nrows();
    let inputs = hessian.nrows() - states;
    let mut cost = hessian.view((0, 0), (states, states)).into_owned();
    for _ in 0..STEPS {
        let all = hessian + dynamics.tr_mul(&(&cost * dynamics));
        let by_inputs = all.view((states, 0), (inputs, states)).into_owned();
        let Some(factor) = all.view((states, states), (inputs, inputs)).into_owned().cholesky() else { break };
        let next = all.view((0, 0), (states, states)) - by_inputs.tr_mul(&factor.solve(&by_inputs));
        let next = (&next + next.transpose()) * 0.5;
        let change = (&next - &cost).amax();
        cost = next;
        if change <= SETTLED * cost.amax() {
            break;
        }
    }
    cost
}

//! Condensing of a trajectory's quadratic model.

use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use uvms_gym::optimize::{Expansion, Knot, condensed};

const STATES: usize = 3;
const INPUTS: usize = 2;
const KNOTS: usize = 4;

/// Cost of the model under these changes of the inputs, followed knot by knot.
fn cost(model: &Expansion, changes: &[f64]) -> f64 {
    let quadratic = |gradient: &DVector<f64>, hessian: &DMatrix<f64>, z: &DVector<f64>| {
        gradient.dot(z) + 0.5 * z.dot(&(hessian * z))
    };
    let (mut state, mut total) = (DVector::zeros(STATES), 0.0);
    for (knot, inputs) in model.knots.iter().zip(changes.chunks_exact(INPUTS)) {
        let z = DVector::from_iterator(STATES + INPUTS, state.iter().chain(inputs).copied());
        total += quadratic(&knot.gradient, &knot.hessian, &z);
        state = &knot.dynamics * z;
    }
    total + quadratic(&model.end.0, &model.end.1, &state)
}

fn numbers(count: usize) -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-1.0..1.0f64, count)
}

fn symmetric(numbers: &[f64]) -> DMatrix<f64> {
    let size = numbers.len().isqrt();
    let root = DMatrix::from_row_slice(size, size, numbers);
    root.tr_mul(&root)
}

const ALL: usize = STATES + INPUTS;

prop_compose! {
    fn knot()(dynamics in numbers(STATES * ALL), gradient in numbers(ALL), hessian in numbers(ALL * ALL)) -> Knot {
        Knot {
            dynamics: DMatrix::from_row_slice(STATES, ALL, &dynamics),
            gradient: gradient.into(),
            hessian: symmetric(&hessian),
        }
    }
}

prop_compose! {
    fn model()(
        knots in prop::collection::vec(knot(), KNOTS), gradient in numbers(STATES), hessian in numbers(STATES * STATES)
    ) -> Expansion {
        Expansion { knots, end: (gradient.into(), symmetric(&hessian)) }
    }
}

proptest! {
    #[test]
    fn it_is_the_cost_that_follows_from_the_knots(model in model(), changes in numbers(KNOTS * INPUTS)) {
        let (hessian, gradient) = condensed(&model);
        let change = DVector::from_vec(changes.clone());
        let at_once = gradient.dot(&change) + 0.5 * change.dot(&(&hessian * &change));
        let followed = cost(&model, &changes);
        prop_assert!((at_once - followed).abs() < 1e-12 * (1.0 + followed.abs()), "{at_once} {followed}");
        prop_assert!((&hessian - hessian.transpose()).amax() < 1e-12 * (1.0 + hessian.amax()));
    }
}

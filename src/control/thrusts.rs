//! Thrusts relative to their ranges, as predictive controllers plan them.

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector};

use super::Allocation;

/// Weight on thrusts that cancel each other, over the maximum weight on effort.
const CANCELLING: f64 = 1e3;

/// Map between relative thrusts and wrenches, and bounds of the thrusts.
#[derive(Debug, Clone, PartialEq)]
pub struct RelativeThrusts {
    /// Wrench per relative thrust, N and N m, (6, m).
    pub wrench: DMatrix<f64>,
    /// Its weighted pseudo-inverse, (m, 6).
    pub inverse: DMatrix<f64>,
    /// Minimum and maximum, at most 1 in magnitude.
    pub bounds: [DVector<f64>; 2],
}

impl RelativeThrusts {
    /// Relative thrusts of an allocation's thrusters.
    pub fn new(allocation: &Allocation) -> Self {
        let m = allocation.count();
        let over = |i: usize, x: f64| if allocation.range(i) > 0.0 { x / allocation.range(i) } else { 0.0 };
        Self {
            wrench: DMatrix::from_fn(6, m, |k, i| allocation.column(i)[k] * allocation.range(i)),
            inverse: DMatrix::from_fn(m, 6, |i, k| over(i, allocation.pseudo_inverse(i)[k])),
            bounds: [0, 1].map(|side| DVector::from_fn(m, |i, _| over(i, allocation.limits(i)[side]))),
        }
    }

    /// Number of thrusters m.
    pub fn count(&self) -> usize {
        self.wrench.ncols()
    }

    /// Root of the cost of thrusts that cancel each other, beside these weights on efforts, (m, m).
    pub(super) fn cancelling_root<'a>(&self, weights: impl IntoIterator<Item = &'a f64>) -> DMatrix<f64> {
        let most = weights.into_iter().fold(MIN_EFFORT, |a, b| a.max(*b));
        (DMatrix::identity(self.count(), self.count()) - &self.inverse * &self.wrench) * (CANCELLING * most).sqrt()
    }
}

/// Minimum weight on effort, m2: without any the cost has no minimum.
pub(super) const MIN_EFFORT: f64 = 1e-8;

/// Bounds of plans of `count` thrusts each, with no thrust of a lost thruster.
pub(super) fn without(bounds: &[DVector<f64>; 2], lost: Option<usize>, count: usize) -> Cow<'_, [DVector<f64>; 2]> {
    let Some(lost) = lost else { return Cow::Borrowed(bounds) };
    let mut bounds = bounds.clone();
    bounds.iter_mut().for_each(|bound| bound.iter_mut().skip(lost).step_by(count).for_each(|x| *x = 0.0));
    Cow::Owned(bounds)
}

//! Iterations: model, backward pass, line search.

use super::backward::{Expansion, Policy, Ranges, backward};
use crate::limits::interrupt;

/// Step sizes of a line search: the first by itself, then the others at once.
pub const STEP_SIZES: [f64; 8] = [1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125, 0.015625, 0.0078125];
/// Minimum part of the expected decrease of an accepted step.
const SUFFICIENT: f64 = 1e-4;
/// Damping after the first failure, and the maximum.
const DAMPING: [f64; 2] = [1e-3, 1e9];

/// Problem about its present trajectory.
pub trait Problem {
    /// Quadratic model.
    fn expand(&mut self) -> Expansion;
    /// Minimum and maximum change of the inputs.
    fn ranges(&self) -> Ranges;
    /// Costs of trajectories under the policies, one for each of these step sizes; under the present inputs without policies.
    fn search(&mut self, policies: Option<&[Policy]>, sizes: &[f64]) -> Vec<f64>;
    /// Makes a trajectory of the last search the present one.
    fn accept(&mut self, candidate: usize);
}

/// Limits of the iterations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Maximum number of iterations.
    pub iterations: usize,
    /// Decrease of the cost expected of an undamped step, over the cost, at which the iterations end.
    pub tolerance: f64,
}

/// Result of the iterations.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// Costs, from the first inputs on: each is below the one before.
    pub costs: Vec<f64>,
    /// Policies about the last trajectory.
    pub policies: Vec<Policy>,
    /// Decrease expected of another step, over the cost.
    pub decrement: f64,
    /// True where that is within the tolerance.
    pub converged: bool,
}

/// Minimises the cost from the present inputs on. None where their cost is not finite, or where their model has no minimum at
/// any damping: its numbers are not finite. None at an interrupt, too.
pub fn solve(problem: &mut impl Problem, settings: &Settings) -> Option<Solution> {
    let mut cost = problem.search(None, &STEP_SIZES[..1])[0];
    if !cost.is_finite() {
        return None;
    }
    problem.accept(0);
    let (mut costs, mut damping) = (vec![cost], 0.0);
    let mut solution = Solution { costs: Vec::new(), policies: Vec::new(), decrement: f64::INFINITY, converged: false };
    'iterations: loop {
        let (model, ranges) = (problem.expand(), problem.ranges());
        if interrupt::requested() {
            return None;
        }
        loop {
            if let Some(pass) = backward(&model, &ranges, damping) {
                // A damped step is shorter by about that factor, and expects a smaller decrease.
                let expected = -(pass.slope + 0.5 * pass.curvature) * (1.0 + damping);
                solution.decrement = if expected <= 0.0 { 0.0 } else { expected / cost.abs().max(f64::MIN_POSITIVE) };
                solution.converged = solution.decrement <= settings.tolerance;
                solution.policies = pass.policies;
                if solution.converged || costs.len() > settings.iterations {
                    break 'iterations;
                }
                for sizes in [&STEP_SIZES[..1], &STEP_SIZES[1..]] {
                    let trials = problem.search(Some(&solution.policies), sizes);
                    let enough = |k: &usize| {
                        let size = sizes[*k];
                        cost - trials[*k] >= -SUFFICIENT * size * (pass.slope + 0.5 * size * pass.curvature)
                    };
                    if let Some(k) = (0..sizes.len()).find(enough) {
                        problem.accept(k);
                        cost = trials[k];
                        costs.push(cost);
                        damping = if damping > DAMPING[0] { 0.1 * damping } else { 0.0 };
                        continue 'iterations;
                    }
                }
            }
            damping = (10.0 * damping).max(DAMPING[0]);
            if damping > DAMPING[1] {
                break 'iterations;
            }
        }
    }
    // Without knots' policies no pass succeeded.
    (!solution.policies.is_empty()).then_some(Solution { costs, ..solution })
}

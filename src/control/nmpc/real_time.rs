//! Real-time iteration: one Gauss-Newton step of a plan per control period, from the plan before. `[Die02]`

use nalgebra::{DMatrix, DVector};

use crate::optimize::{Expansion, Knot, Policy, Problem, Ranges, STEP_SIZES, Settings, condensed, minimise, solve};

/// Relative decrease of the cost, as the model expects it, below which a plan is optimal.
const OPTIMAL: f64 = 1e-3;

/// Discrete model of the controlled system over a plan's control periods.
pub trait PlanModel {
    /// State after control period `knot` from a state under inputs.
    fn step(&self, knot: usize, state: &DVector<f64>, inputs: &DVector<f64>) -> DVector<f64>;
}

/// Quadratic cost of each knot, `(z - target)^T hessian (z - target) / 2` in `z = [state; inputs]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Cost {
    /// Hessian of a knot: of squared weighted residuals.
    pub hessian: DMatrix<f64>,
    /// Hessian of the state after the last one: in station keeping the cost of linear feedback from there on, without limits.
    pub end: DMatrix<f64>,
}

/// Plan from the present state: inputs of each control period, and their problem.
pub struct RealTimePlan<'a, M> {
    model: &'a M,
    cost: &'a Cost,
    /// Derivatives of a control period by z, of all knots.
    dynamics: &'a DMatrix<f64>,
    /// z at which a knot costs nothing; the last one is of the end.
    targets: &'a [DVector<f64>],
    /// Minimum and maximum inputs.
    bounds: &'a [DVector<f64>; 2],
    /// Inputs, and the states before, between and after them.
    present: Trajectory,
    candidates: Vec<Trajectory>,
}

type Trajectory = (Vec<DVector<f64>>, Vec<DVector<f64>>);

impl<'a, M: PlanModel> RealTimePlan<'a, M> {
    /// The plan of a row of memory from a state on.
    pub fn new(
        model: &'a M,
        (cost, dynamics): (&'a Cost, &'a DMatrix<f64>),
        targets: &'a [DVector<f64>],
        bounds: &'a [DVector<f64>; 2],
        state: DVector<f64>,
        memory: &[f64],
    ) -> Self {
        let inputs = memory.chunks_exact(bounds[0].len()).map(DVector::from_column_slice).collect();
        Self { model, cost, dynamics, targets, bounds, present: (inputs, vec![state]), candidates: Vec::new() }
    }

    /// Improves the plan by one iteration, and stores it without its first inputs, which are returned.
    ///
    /// A plan that no step improves, although its model promises it, is too far from the motion: saturated inputs would be repeated
    /// for ever. Another one then begins with the inputs that hold the target, and the cheaper one is continued.
    pub fn improve(mut self, memory: &mut [f64]) -> DVector<f64> {
        let cost = self.iterate();
        if let Err(cost) = cost {
            let (state, holding) = (self.present.1[0].clone(), self.holding());
            let before = std::mem::replace(&mut self.present, (holding, vec![state]));
            let (Ok(other) | Err(other)) = self.iterate();
            if cost < other {
                self.present = before;
            }
        }
        let (inputs, _) = &self.present;
        let later = inputs[1..].iter().chain(inputs.last());
        for (place, entry) in memory.chunks_exact_mut(self.bounds[0].len()).zip(later) {
            place.copy_from_slice(entry.as_slice());
        }
        inputs[0].clone()
    }

    /// Improves the plan by one iteration and returns its cost; an error where the plan stays as it is and is not optimal.
    fn iterate(&mut self) -> Result<f64, f64> {
        let solution = solve(self, &Settings { iterations: 0, tolerance: 0.0 }).ok_or(f64::INFINITY)?;
        let (cost, mut policies, mut decrement) = (solution.costs[0], solution.policies, solution.decrement);
        let mut costs = self.search(Some(&policies), &STEP_SIZES[..1]);
        // A pass knows each knot's bounds by themselves. Where any is active the quadratic program is solved as a whole.
        if self.is_bounded(&self.candidates[0].0) {
            (policies, decrement) = self.bounded_step(cost).ok_or(cost)?;
            costs = self.search(Some(&policies), &STEP_SIZES[..1]);
        }
        // A step that costs more than none is shortened.
        if costs[0] >= cost {
            costs = self.search(Some(&policies), &STEP_SIZES[1..]);
        }
        if let Some(k) = costs.iter().position(|other| *other < cost) {
            self.accept(k);
            return Ok(costs[k]);
        }
        if decrement < OPTIMAL { Ok(cost) } else { Err(cost) }
    }

    /// True if an input is on a bound.
    fn is_bounded(&self, inputs: &[DVector<f64>]) -> bool {
        let [lower, upper] = self.bounds;
        inputs.iter().any(|u| (0..u.len()).any(|k| u[k] <= lower[k] || u[k] >= upper[k]))
    }

    /// Changes of all inputs that minimise the quadratic model within the bounds, and the relative decrease that they promise.
    fn bounded_step(&mut self, cost: f64) -> Option<(Vec<Policy>, f64)> {
        let (hessian, gradient) = condensed(&self.expand());
        let [lower, upper] = [0, 1].map(|side| {
            let ranges = self.ranges();
            DVector::from_iterator(gradient.len(), ranges.iter().flat_map(|range| range[side].iter().copied()))
        });
        let change = minimise(&hessian, &gradient, &lower, &upper)?.x;
        let decrease = -change.dot(&(&hessian * &change * 0.5 + gradient));
        let (states, inputs) = (self.present.1[0].len(), self.bounds[0].len());
        let policy = |feedforward| Policy { feedforward, gain: DMatrix::zeros(inputs, states) };
        let changes = change.as_slice().chunks_exact(inputs).map(DVector::from_column_slice);
        Some((changes.map(policy).collect(), decrease / cost.max(f64::MIN_POSITIVE)))
    }

    /// Inputs that hold the target, within their limits.
    fn holding(&self) -> Vec<DVector<f64>> {
        let [lower, upper] = self.bounds;
        let knots = &self.targets[..self.present.0.len()];
        let hold = |target: &DVector<f64>| target.rows_range(target.len() - lower.len()..).into_owned();
        knots.iter().map(|target| hold(target).sup(lower).inf(upper)).collect()
    }

    /// Gradient and cost at z of a knot.
    fn evaluate(&self, knot: usize, z: &DVector<f64>) -> (DVector<f64>, f64) {
        let off = z - &self.targets[knot];
        let gradient = if knot < self.present.0.len() { &self.cost.hessian * &off } else { &self.cost.end * &off };
        let cost = 0.5 * off.dot(&gradient);
        (gradient, cost)
    }

    fn follow(&self, policies: Option<&[Policy]>, size: f64) -> (Trajectory, f64) {
        let (inputs, states) = &self.present;
        let (mut found, mut state, mut total) = ((Vec::new(), Vec::new()), states[0].clone(), 0.0);
        for (knot, planned) in inputs.iter().enumerate() {
            let mut u = planned.clone();
            if let Some(Policy { feedforward, gain }) = policies.map(|policies| &policies[knot]) {
                u += feedforward * size + gain * (&state - &states[knot]);
            }
            let [lower, upper] = self.bounds;
            let u = DVector::from_fn(u.len(), |k, _| u[k].max(lower[k]).min(upper[k]));
            total += self.evaluate(knot, &stacked(&state, &u)).1;
            let next = self.model.step(knot, &state, &u);
            found.0.push(u);
            found.1.push(std::mem::replace(&mut state, next));
        }
        total += self.evaluate(inputs.len(), &state).1;
        found.1.push(state);
        (found, total)
    }
}

fn stacked(state: &DVector<f64>, inputs: &DVector<f64>) -> DVector<f64> {
    DVector::from_iterator(state.len() + inputs.len(), state.iter().chain(inputs).copied())
}

impl<M: PlanModel> Problem for RealTimePlan<'_, M> {
    fn expand(&mut self) -> Expansion {
        let (inputs, states) = &self.present;
        let knot = |k: usize| Knot {
            dynamics: self.dynamics.clone(),
            gradient: self.evaluate(k, &stacked(&states[k], &inputs[k])).0,
            hessian: self.cost.hessian.clone(),
        };
        let end = (self.evaluate(inputs.len(), &states[inputs.len()]).0, self.cost.end.clone());
        Expansion { knots: (0..inputs.len()).map(knot).collect(), end }
    }

    fn ranges(&self) -> Ranges {
        self.present.0.iter().map(|inputs| self.bounds.each_ref().map(|bound| bound - inputs)).collect()
    }

    fn search(&mut self, policies: Option<&[Policy]>, sizes: &[f64]) -> Vec<f64> {
        let (found, costs) = sizes.iter().map(|size| self.follow(policies, *size)).unzip();
        self.candidates = found;
        costs
    }

    fn accept(&mut self, candidate: usize) {
        self.present = self.candidates.swap_remove(candidate);
    }
}

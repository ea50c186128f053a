//! Tracking problem of one instance: its motion under chosen inputs, and the models of that motion.

use nalgebra as na;

use super::cost::{StateCost, reference_width, residuals};
use super::tangent::difference;
use crate::batch::{Argument, Inputs, Simulator};
use crate::error::SimulatorError;
use crate::limits::interrupt;
use crate::optimize::{Expansion, Knot, Policy, Problem, Ranges};
use crate::system::State;

/// Numbers of one problem, or of N problems one after another; entries of all inputs: w.
#[derive(Clone, Copy)]
pub struct Numbers<'a> {
    /// (N, horizon + 1, [`reference_width`]).
    pub references: &'a [f64],
    /// (N, horizon + 1, [`residuals`]), at least 0.
    pub weights: &'a [f64],
    /// (N, horizon, w).
    pub input_references: &'a [f64],
    /// (N, horizon, w), greater than 0.
    pub input_weights: &'a [f64],
    /// Minimum inputs, (N, horizon, w); may be infinite.
    pub lower: &'a [f64],
    /// Maximum inputs, (N, horizon, w); may be infinite.
    pub upper: &'a [f64],
}

/// Inputs and states along a trajectory.
#[derive(Debug, Clone, Default)]
pub struct Trajectory {
    /// Inputs of all knots, (horizon, w).
    pub inputs: Vec<f64>,
    /// States at all knots.
    pub states: Vec<State>,
    /// Every number of the simulator before each knot.
    pub saved: Vec<f64>,
}

/// Tracking problem of one instance.
pub struct Tracking<'a> {
    pub numbers: Numbers<'a>,
    pub cost: StateCost<'a>,
    pub arguments: &'a [(Argument, usize)],
    pub substeps: usize,
    /// Simulators of the instance: of the first step size, of the others, and of the knots.
    pub trials: [Simulator; 2],
    pub knots: Simulator,
    /// Every number of the instance at the start.
    pub start: Vec<f64>,
    /// The present trajectory; at first inputs alone.
    pub present: Trajectory,
    pub candidates: Vec<Trajectory>,
    /// First error of the simulators.
    pub error: Option<SimulatorError>,
}

/// Inputs (rows, w) of each argument from rows of all inputs.
fn split(arguments: &[(Argument, usize)], rows: &[f64]) -> Vec<(Argument, Vec<f64>)> {
    let all: usize = arguments.iter().map(|(_, width)| width).sum();
    let mut first = 0;
    let part = |&(argument, width): &(Argument, usize)| {
        let part = rows.chunks_exact(all).flat_map(|row| &row[first..first + width]).copied().collect();
        first += width;
        (argument, part)
    };
    arguments.iter().map(part).collect()
}

fn inputs(parts: &[(Argument, Vec<f64>)]) -> Inputs<'_> {
    let of = |wanted| parts.iter().find(|(argument, _)| *argument == wanted).map(|(_, rows)| &rows[..]);
    Inputs {
        thrust: of(Argument::Thrust),
        fin: of(Argument::Fin),
        wrench: of(Argument::Wrench),
        joint_torque: of(Argument::JointTorque),
        joint_target: of(Argument::JointTarget),
        ..Inputs::default()
    }
}

impl Tracking<'_> {
    fn width(&self) -> usize {
        self.arguments.iter().map(|(_, width)| width).sum()
    }

    fn horizon(&self) -> usize {
        self.knots.instances()
    }

    fn input_cost(&self, knot: usize, inputs: &[f64]) -> f64 {
        let (w, at) = (self.width(), knot * self.width());
        let numbers = self.numbers.input_weights[at..at + w].iter().zip(&self.numbers.input_references[at..at + w]);
        inputs.iter().zip(numbers).map(|(u, (weight, d))| 0.5 * weight * (u - d) * (u - d)).sum()
    }

    /// Reference and weights of the state at a knot.
    fn numbers_at(&self, knot: usize) -> (&[f64], &[f64]) {
        let n = self.cost.joints;
        let (reference, weights) = (reference_width(n), residuals(n));
        let Numbers { references, weights: all, .. } = self.numbers;
        (&references[knot * reference..][..reference], &all[knot * weights..][..weights])
    }

    /// Inputs of a knot by a policy from a state.
    fn policy_inputs(&self, knot: usize, policy: &Policy, size: f64, state: &State) -> Vec<f64> {
        let StateCost { joints, thrusters, .. } = self.cost;
        let change = &policy.feedforward * size
            + &policy.gain * difference(&self.present.states[knot], state, joints, thrusters);
        let (w, at) = (self.width(), knot * self.width());
        let new = |k: usize| {
            let changed = self.present.inputs[at + k] + change[k];
            // A trajectory that diverges keeps the inputs that are numbers.
            let changed = if changed.is_finite() { changed } else { self.present.inputs[at + k] };
            changed.clamp(self.numbers.lower[at + k], self.numbers.upper[at + k])
        };
        (0..w).map(new).collect()
    }

    fn try_search(&mut self, policies: Option<&[Policy]>, sizes: &[f64]) -> Result<Vec<f64>, SimulatorError> {
        let (mut costs, w, horizon) = (vec![0.0; sizes.len()], self.width(), self.horizon());
        let which = usize::from(sizes.len() > 1);
        self.trials[which].load(&self.start.repeat(sizes.len()))?;
        let mut found = vec![Trajectory::default(); sizes.len()];
        for knot in 0..=horizon {
            if interrupt::requested() {
                return Ok(vec![f64::NAN; sizes.len()]);
            }
            let (saved, mut rows) = (self.trials[which].save(), Vec::with_capacity(sizes.len() * w));
            for (k, trajectory) in found.iter_mut().enumerate() {
                let state = self.trials[which].state(k);
                let (reference, weights) = self.numbers_at(knot);
                costs[k] += self.cost.value(&state, reference, weights);
                if knot < horizon {
                    let chosen = match policies {
                        Some(policies) => self.policy_inputs(knot, &policies[knot], sizes[k], &state),
                        None => self.present.inputs[knot * w..][..w].to_vec(),
                    };
                    costs[k] += self.input_cost(knot, &chosen);
                    rows.extend_from_slice(&chosen);
                    trajectory.inputs.extend(chosen);
                    trajectory.saved.extend_from_slice(&saved[k * self.start.len()..][..self.start.len()]);
                }
                trajectory.states.push(state);
            }
            if knot < horizon {
                self.trials[which].step(&inputs(&split(self.arguments, &rows)), self.substeps)?;
            }
        }
        self.candidates = found;
        Ok(costs)
    }

    fn try_expand(&mut self) -> Result<Vec<Knot>, SimulatorError> {
        self.knots.load(&self.present.saved)?;
        let parts = split(self.arguments, &self.present.inputs);
        let jacobians = self.knots.step_jacobians(&inputs(&parts), self.substeps, &[])?;
        let (w, s) = (self.width(), jacobians.size);
        let knot = |(knot, rows): (usize, &[f64])| {
            let (reference, weights) = self.numbers_at(knot);
            let (by_state, of_state) = self.cost.expand(&self.present.states[knot], reference, weights);
            let (mut gradient, mut hessian) = (na::DVector::zeros(s + w), na::DMatrix::zeros(s + w, s + w));
            gradient.rows_mut(0, s).copy_from(&by_state);
            hessian.view_mut((0, 0), (s, s)).copy_from(&of_state);
            for k in 0..w {
                let (at, weights) = (knot * w + k, self.numbers.input_weights);
                gradient[s + k] = weights[at] * (self.present.inputs[at] - self.numbers.input_references[at]);
                hessian[(s + k, s + k)] = weights[at];
            }
            Knot { dynamics: na::DMatrix::from_row_slice(s, s + w, rows), gradient, hessian }
        };
        let rows = jacobians.numbers.chunks_exact(s * (s + w)).enumerate();
        Ok(rows.take_while(|_| !interrupt::requested()).map(knot).collect())
    }
}

impl Problem for Tracking<'_> {
    fn expand(&mut self) -> Expansion {
        let knots = self.try_expand().unwrap_or_else(|error| {
            self.error.get_or_insert(error);
            Vec::new()
        });
        let (reference, weights) = self.numbers_at(self.horizon());
        let end = self.cost.expand(&self.present.states[self.horizon()], reference, weights);
        Expansion { knots, end }
    }

    fn ranges(&self) -> Ranges {
        let w = self.width();
        let minus_present = |bounds: &[f64], knot: usize| {
            na::DVector::from_fn(w, |k, _| bounds[knot * w + k] - self.present.inputs[knot * w + k])
        };
        (0..self.horizon())
            .map(|knot| [minus_present(self.numbers.lower, knot), minus_present(self.numbers.upper, knot)])
            .collect()
    }

    fn search(&mut self, policies: Option<&[Policy]>, sizes: &[f64]) -> Vec<f64> {
        self.try_search(policies, sizes).unwrap_or_else(|error| {
            self.error.get_or_insert(error);
            vec![f64::NAN; sizes.len()]
        })
    }

    fn accept(&mut self, candidate: usize) {
        self.present = self.candidates.swap_remove(candidate);
    }
}

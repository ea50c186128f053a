//! Linear model and cost of MPC.

use nalgebra::{DMatrix, DVector, Matrix6, Vector6};

use super::gains::MpcGains;
use crate::control::indices::ATTITUDE_LEVER;
use crate::control::kalman::WaveTransition;
use crate::control::plant::{Plant, lag_decay};
use crate::system::Joints;

/// Control periods for which each wrench of a plan is held.
pub const MOVES: [usize; 4] = [1, 2, 4, 8];
/// Control periods of the Riccati iteration for the cost beyond the plan.
const TAIL: usize = 200;
/// Minimum weight on effort: without any the cost has no minimum.
const MIN_EFFORT: f64 = 1e-8;

/// The linear model, and the square roots of the weights.
pub struct LinearModel {
    inverse: Matrix6<f64>,
    period: f64,
    /// Decay of the thrusters' gap over a period: at its end, and on average.
    end: f64,
    mean: f64,
    unit: [f64; 6],
    pose: Vector6<f64>,
    velocity: Vector6<f64>,
    effort: Vector6<f64>,
    change: Vector6<f64>,
    /// Root of the cost beyond the plan, by pose error, twist, and wrench beyond compensation.
    tail: DMatrix<f64>,
    frequency: f64,
}

/// The k-th six numbers.
fn six(from: &[f64], k: usize) -> Vector6<f64> {
    Vector6::from_column_slice(&from[6 * k..6 * k + 6])
}

impl LinearModel {
    pub fn new(plant: &Plant, home: &Joints, unit: [f64; 6], gains: &MpcGains, period: f64) -> Self {
        let inertia = plant.inertia(home);
        let (end, mean) = lag_decay(period, plant.lag());
        let pushes = unit.map(|limit| limit > 0.0);
        let root = |k: usize, weight: f64| if pushes[k] { weight.sqrt() } else { 0.0 };
        let lever = |k: usize| if k < 3 { 1.0 } else { ATTITUDE_LEVER };
        let all = |weights: [f64; 2]| Vector6::from_fn(|k, _| root(k, weights[k / 3]));
        let mut model = Self {
            // Positive definite.
            inverse: inertia.try_inverse().unwrap_or_else(Matrix6::zeros),
            period,
            end,
            mean,
            unit,
            pose: Vector6::from_fn(|k, _| root(k, 1.0) * lever(k)),
            velocity: all(gains.velocity).component_mul(&Vector6::from_fn(|k, _| lever(k))),
            effort: all(gains.effort),
            change: all(gains.change),
            tail: DMatrix::zeros(18, 18),
            frequency: gains.observer.wave_frequency,
        };
        model.tail = model.cost_to_go();
        model
    }

    /// A control period: pose error, twist and thrusters' wrench under an external wrench and a command.
    fn step(&self, state: &mut [Vector6<f64>; 3], external: Vector6<f64>, command: Vector6<f64>) {
        let [error, twist, thrust] = *state;
        let acceleration = self.inverse * (command + (thrust - command) * self.mean + external);
        let t = self.period;
        *state = [
            error + twist * t + acceleration * (0.5 * t * t),
            twist + acceleration * t,
            command + (thrust - command) * self.end,
        ];
    }

    fn units(&self, wrench: Vector6<f64>) -> Vector6<f64> {
        wrench.component_mul(&Vector6::from(self.unit))
    }

    fn over_units(&self, wrench: Vector6<f64>) -> Vector6<f64> {
        Vector6::from_fn(|k, _| if self.unit[k] > 0.0 { wrench[k] / self.unit[k] } else { 0.0 })
    }

    /// Root of the cost of linear feedback from a state on, by its Riccati equation.
    fn cost_to_go(&self) -> DMatrix<f64> {
        let (mut a, mut b) = (DMatrix::zeros(18, 18), DMatrix::zeros(18, 6));
        for column in 0..24 {
            let mut x = [0.0; 24];
            x[column] = 1.0;
            let mut state = [six(&x, 0), six(&x, 1), six(&x, 2)];
            self.step(&mut state, Vector6::zeros(), self.units(six(&x, 3)));
            let after = DVector::from_iterator(18, state.iter().flat_map(|part| part.iter().copied()));
            if column < 18 { a.set_column(column, &after) } else { b.set_column(column - 18, &after) }
        }
        let mut weight = DMatrix::zeros(18, 18);
        let mut effort = DMatrix::identity(6, 6);
        for k in 0..6 {
            weight[(k, k)] = self.pose[k].powi(2);
            weight[(6 + k, 6 + k)] = self.velocity[k].powi(2);
            if self.unit[k] > 0.0 {
                effort[(k, k)] = self.effort[k].powi(2).max(MIN_EFFORT);
            }
        }
        let mut cost = weight.clone();
        for _ in 0..TAIL {
            let cost_b = &cost * &b;
            let Some(inverse) = (&effort + b.tr_mul(&cost_b)).try_inverse() else { break };
            let feedback = inverse * cost_b.tr_mul(&a);
            let closed = &a - &b * &feedback;
            cost = &weight + closed.tr_mul(&(&cost * &closed)) + feedback.tr_mul(&(&effort * &feedback));
            cost = (&cost + cost.transpose()) * 0.5;
        }
        let eigen = cost.symmetric_eigen();
        let roots = eigen.eigenvalues.map(|x| x.max(0.0).sqrt());
        DMatrix::from_diagonal(&roots) * eigen.eigenvectors.transpose()
    }

    /// Square roots of the terms of a plan's cost; linear in plan and parameters.
    pub fn residuals(&self, plan: &[f64], parameters: &[f64]) -> Vec<f64> {
        let mut state = [six(parameters, 0), six(parameters, 1), six(parameters, 2)];
        let [mut last, steady, wave, rate] = [3, 4, 5, 6].map(|k| six(parameters, k));
        let (mut all, mut time) = (Vec::new(), 0.0);
        let mut external = steady;
        for (k, periods) in MOVES.into_iter().enumerate() {
            let share = six(plan, k);
            let command = self.units(share);
            // An axis without thrust is held at 0.
            all.extend((0..6).filter(|&k| self.unit[k] == 0.0).map(|k| share[k]));
            all.extend(self.change.component_mul(&self.over_units(command - last)).iter());
            last = command;
            for _ in 0..periods {
                let WaveTransition([[a, b], _]) = WaveTransition::over(self.frequency, time + 0.5 * self.period);
                external = steady + wave * a + rate * b;
                let effort = self.effort.map(|root| root.max(MIN_EFFORT.sqrt()));
                all.extend(effort.component_mul(&self.over_units(command + external)).iter());
                self.step(&mut state, external, command);
                time += self.period;
                all.extend(self.pose.component_mul(&state[0]).iter());
                all.extend(self.velocity.component_mul(&state[1]).iter());
            }
        }
        let end = DVector::from_iterator(18, state[0].iter().chain(&state[1]).chain(&(state[2] + external)).copied());
        all.extend((&self.tail * end).iter());
        all
    }
}

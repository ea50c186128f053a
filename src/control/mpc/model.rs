//! Linear model and cost of MPC.

use nalgebra::{DMatrix, DVector, Matrix6, Vector6};

use super::PARAMETERS;
use super::gains::MpcGains;
use crate::control::indices::ATTITUDE_LEVER;
use crate::control::kalman::WaveTransition;
use crate::control::nominal_model::{NominalModel, lag_decay};
use crate::control::thrusts::MIN_EFFORT;
use crate::optimize::cost_to_go;
use crate::system::Joints;

/// Control periods of each move of a plan, over which its thrusts are constant.
pub const MOVES: [usize; 4] = [1, 2, 4, 8];

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
    /// Hessian of the cost beyond the plan, by pose error, twist, and wrench beyond compensation.
    tail: DMatrix<f64>,
    frequency: f64,
}

fn six(from: &[f64], k: usize) -> Vector6<f64> {
    Vector6::from_column_slice(&from[6 * k..6 * k + 6])
}

impl LinearModel {
    /// Model with the arm at home, for thrusters with these wrench limits.
    pub fn new(model: &NominalModel, home: &Joints, unit: [f64; 6], gains: &MpcGains, period: f64) -> Self {
        let inertia = model.inertia(home);
        let (end, mean) = lag_decay(period, model.lag());
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
        model.tail = model.cost_beyond();
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

    /// Hessian of the cost of linear feedback from a state on.
    fn cost_beyond(&self) -> DMatrix<f64> {
        let mut dynamics = DMatrix::zeros(18, 24);
        for column in 0..24 {
            let mut x = [0.0; 24];
            x[column] = 1.0;
            let mut state = [six(&x, 0), six(&x, 1), six(&x, 2)];
            self.step(&mut state, Vector6::zeros(), self.units(six(&x, 3)));
            let after = DVector::from_iterator(18, state.iter().flat_map(|part| part.iter().copied()));
            dynamics.set_column(column, &after);
        }
        let mut hessian = DMatrix::zeros(24, 24);
        for k in 0..6 {
            hessian[(k, k)] = self.pose[k].powi(2);
            hessian[(6 + k, 6 + k)] = self.velocity[k].powi(2);
            hessian[(18 + k, 18 + k)] = if self.unit[k] > 0.0 { self.effort[k].powi(2).max(MIN_EFFORT) } else { 1.0 };
        }
        cost_to_go(&hessian, &dynamics)
    }

    /// Hessian of a plan's cost by its wrenches, N and N m, and the parameters.
    pub fn hessian(&self) -> DMatrix<f64> {
        let size = 6 * MOVES.len() + PARAMETERS;
        let column = |k: usize| {
            let mut all = vec![0.0; size];
            all[k] = 1.0;
            self.residuals(&all[..6 * MOVES.len()], &all[6 * MOVES.len()..])
        };
        let (roots, ends): (Vec<_>, Vec<_>) = (0..size).map(column).unzip();
        let (roots, ends) = (DMatrix::from_columns(&roots), DMatrix::from_columns(&ends));
        roots.tr_mul(&roots) + ends.tr_mul(&(&self.tail * &ends))
    }

    /// Cost of a plan, by its wrenches, N and N m, and its parameters.
    pub fn cost(&self, plan: &[f64], parameters: &[f64]) -> f64 {
        let (roots, end) = self.residuals(plan, parameters);
        roots.norm_squared() + end.dot(&(&self.tail * &end))
    }

    /// Square roots of the terms of a plan's cost, and the state at its end; linear in plan and parameters.
    fn residuals(&self, plan: &[f64], parameters: &[f64]) -> (DVector<f64>, DVector<f64>) {
        let mut state = [six(parameters, 0), six(parameters, 1), six(parameters, 2)];
        let [mut last, steady, wave, rate] = [3, 4, 5, 6].map(|k| six(parameters, k));
        let (mut all, mut time): (Vec<f64>, _) = (Vec::new(), 0.0);
        let mut external = steady;
        for (k, periods) in MOVES.into_iter().enumerate() {
            let command = six(plan, k);
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
        (DVector::from_vec(all), end)
    }
}

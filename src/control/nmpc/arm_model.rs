//! Model of tracking over a plan: vehicle and arm under thrusts and torques, the reference ahead, and a disturbance
//! that stays.

use nalgebra::{DMatrix, DVector, Vector3, Vector6};

use super::real_time::Model;
use crate::control::ActionMap;
use crate::control::resolved_motion::{Bank, Estimate, ModelTerms, NominalModel, TrackingState};
use crate::dynamics::Velocities;

/// Step of differences.
const STEP: f64 = 1e-6;

/// Entries of a state, `[pose error (6); up (3); q (n); V (6); q' (n); thrusters' wrench (6)]`, and of inputs: thrusts
/// and torques over their ranges.
pub struct Layout {
    pub joints: usize,
    /// Wrench per relative thrust, and its pseudo-inverse.
    wrench: DMatrix<f64>,
    inverse: DMatrix<f64>,
    torques: Vec<f64>,
}

impl Layout {
    pub fn new(actions: &ActionMap) -> Self {
        let (allocation, torques) = (actions.allocation(), actions.torques().to_vec());
        let range = |i: usize| allocation.range(i);
        let wrench = DMatrix::from_fn(6, allocation.count(), |k, i| allocation.column(i)[k] * range(i));
        let over = |i: usize, x: f64| if range(i) > 0.0 { x / range(i) } else { 0.0 };
        let inverse = DMatrix::from_fn(allocation.count(), 6, |i, k| over(i, allocation.pseudo_inverse(i)[k]));
        Self { joints: torques.len(), wrench, inverse, torques }
    }

    /// Entries of a state.
    pub fn states(&self) -> usize {
        self.thrust() + 6
    }

    /// Entries of the inputs.
    pub fn inputs(&self) -> usize {
        self.wrench.ncols() + self.joints
    }

    /// Place of the velocities.
    pub fn velocity(&self) -> usize {
        9 + self.joints
    }

    /// Place of the thrusters' wrench.
    pub fn thrust(&self) -> usize {
        15 + 2 * self.joints
    }

    /// Entry `k` of the wrench per input.
    pub fn wrench(&self, k: usize, input: usize) -> f64 {
        if input < self.wrench.ncols() { self.wrench[(k, input)] } else { 0.0 }
    }

    /// Projection of thrusts onto those without a wrench.
    pub fn cancelling(&self) -> DMatrix<f64> {
        DMatrix::identity(self.wrench.ncols(), self.wrench.ncols()) - &self.inverse * &self.wrench
    }

    /// Wrench and torques of inputs.
    pub fn effort(&self, inputs: &DVector<f64>) -> Velocities {
        let (mut effort, count) = (Velocities::zeros(), self.wrench.ncols());
        effort.fixed_rows_mut::<6>(0).copy_from(&(&self.wrench * inputs.rows(0, count)));
        (0..self.joints).for_each(|k| effort[6 + k] = self.torques[k] * inputs[count + k]);
        effort
    }

    /// Inputs of an effort, without limits.
    pub fn relative(&self, effort: &Velocities) -> DVector<f64> {
        let thrusts = &self.inverse * effort.fixed_rows::<6>(0);
        let over = |k: usize| if self.torques[k] > 0.0 { effort[6 + k] / self.torques[k] } else { 0.0 };
        DVector::from_iterator(self.inputs(), thrusts.iter().copied().chain((0..self.joints).map(over)))
    }
}

/// The nominal model from the present on.
pub struct ArmModel<'a> {
    pub layout: &'a Layout,
    pub model: &'a NominalModel,
    pub bank: &'a Bank,
    /// The present, and the terms of the model there.
    pub estimate: &'a Estimate,
    pub terms: &'a ModelTerms,
    /// Mean twist of the reference in each control period.
    pub rates: &'a [Vector6<f64>],
}

impl ArmModel<'_> {
    /// The present state.
    pub fn present(&self) -> DVector<f64> {
        self.pack(&self.estimate.now, &self.estimate.wrench)
    }

    /// Effort that holds the present velocities against the model's forces and the disturbance.
    pub fn holding_effort(&self) -> Velocities {
        let mut hold = self.terms.motion.bias - self.estimate.disturbance;
        (0..self.layout.joints).for_each(|k| hold[6 + k] -= self.terms.passive[k].torque);
        hold
    }

    fn pack(&self, state: &TrackingState, wrench: &Vector6<f64>) -> DVector<f64> {
        let n = self.layout.joints;
        let TrackingState { error, up, q, velocities, .. } = state;
        let entries = error.iter().chain(up).chain(&q[..n]).chain(&velocities.as_slice()[..6 + n]).chain(wrench);
        DVector::from_iterator(self.layout.states(), entries.copied())
    }

    fn unpack(&self, knot: usize, x: &DVector<f64>) -> (TrackingState, Vector6<f64>) {
        let n = self.layout.joints;
        let mut state = self.estimate.now.clone();
        state.error.copy_from(&x.fixed_rows::<6>(0));
        state.up = Vector3::new(x[6], x[7], x[8]);
        state.q[..n].copy_from_slice(&x.as_slice()[9..9 + n]);
        state.velocities.rows_mut(0, 6 + n).copy_from(&x.rows(self.layout.velocity(), 6 + n));
        (state.reference, state.acceleration) = (self.rates[knot], Vector6::zeros());
        (state, x.fixed_rows::<6>(self.layout.thrust()).into_owned())
    }

    /// Derivatives of the first control period by z, at the present state and command.
    pub fn dynamics(&self) -> DMatrix<f64> {
        let (layout, s, thrust) = (self.layout, self.layout.states(), self.estimate.wrench);
        let (x, held) = (self.present(), self.layout.relative(&self.holding_effort()));
        let mut dynamics = DMatrix::zeros(s, s + layout.inputs());
        // The error changes itself alone; thrusters and inputs change the forces alone.
        (0..6).for_each(|k| dynamics[(k, k)] = 1.0);
        let (base, _) = self.unpack(0, &x);
        let by_force =
            |wrench: Vector6<f64>, inputs: &DVector<f64>| self.advance(self.terms, (base.clone(), wrench), inputs);
        let from = by_force(thrust, &held);
        for k in 6..layout.thrust() {
            let mut x = x.clone();
            x[k] += STEP;
            dynamics.set_column(k, &((self.step(0, &x, &held) - &from) / STEP));
        }
        for k in 0..6 {
            let mut wrench = thrust;
            wrench[k] += 1.0;
            dynamics.set_column(layout.thrust() + k, &(by_force(wrench, &held) - &from));
        }
        for k in 0..layout.inputs() {
            let mut inputs = held.clone();
            inputs[k] += STEP;
            dynamics.set_column(s + k, &((by_force(thrust, &inputs) - &from) / STEP));
        }
        dynamics
    }

    /// State a control period later.
    fn advance(
        &self,
        terms: &ModelTerms,
        (mut state, mut wrench): (TrackingState, Vector6<f64>),
        inputs: &DVector<f64>,
    ) -> DVector<f64> {
        let forces = [&self.layout.effort(inputs), &self.estimate.disturbance];
        self.bank.predictor.advance(self.model, terms, (&mut state, &mut wrench), forces, 0.0);
        self.pack(&state, &wrench)
    }
}

impl Model for ArmModel<'_> {
    fn step(&self, knot: usize, x: &DVector<f64>, inputs: &DVector<f64>) -> DVector<f64> {
        let from = self.unpack(knot, x);
        self.advance(&self.model.terms(&from.0), from, inputs)
    }
}

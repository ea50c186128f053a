//! Model of tracking over a plan: vehicle and arm under thrusts and torques, the reference ahead, and a disturbance
//! that stays.

use nalgebra::{DMatrix, DVector, Vector3, Vector6};

use super::real_time::PlanModel;
use crate::control::ActionMap;
use crate::control::equations::{ChainState, Equations, Velocities};
use crate::control::nominal_model::NominalModel;
use crate::control::resolved_motion::{MotionBank, MotionEstimate, TrackingState};
use crate::control::thrusts::RelativeThrusts;

/// Entries of a state, `[pose error (6); up (3); q (n); V (6); q' (n); thrusters' wrench (6)]`, and of inputs: thrusts
/// and torques over their ranges.
pub struct PlanLayout {
    /// Number of joints n.
    pub joints: usize,
    /// Thrusts.
    pub thrusts: RelativeThrusts,
    /// Torque of 1, N m or N.
    torques: Vec<f64>,
}

impl PlanLayout {
    /// Layout for these actions.
    pub fn new(actions: &ActionMap) -> Self {
        let (thrusts, torques) = (RelativeThrusts::new(actions.allocation()), actions.torques().to_vec());
        Self { joints: torques.len(), thrusts, torques }
    }

    /// Minimum and maximum inputs.
    pub fn bounds(&self) -> [DVector<f64>; 2] {
        [0, 1].map(|side| {
            let mut bound = DVector::from_element(self.inputs(), [-1.0, 1.0][side]);
            bound.rows_mut(0, self.thrusts.count()).copy_from(&self.thrusts.bounds[side]);
            bound
        })
    }

    /// Entries of a state.
    pub fn states(&self) -> usize {
        self.thrust() + 6
    }

    /// Entries of the inputs.
    pub fn inputs(&self) -> usize {
        self.thrusts.count() + self.joints
    }

    /// Place of the velocities.
    pub fn velocity(&self) -> usize {
        9 + self.joints
    }

    /// Place of the thrusters' wrench.
    pub fn thrust(&self) -> usize {
        15 + 2 * self.joints
    }

    /// Wrench and torques of inputs.
    pub fn effort(&self, inputs: &DVector<f64>) -> Velocities {
        let (mut effort, count) = (Velocities::zeros(), self.thrusts.count());
        effort.fixed_rows_mut::<6>(0).copy_from(&(&self.thrusts.wrench * inputs.rows(0, count)));
        (0..self.joints).for_each(|k| effort[6 + k] = self.torques[k] * inputs[count + k]);
        effort
    }

    /// Inputs of an effort, without limits.
    pub fn relative(&self, effort: &Velocities) -> DVector<f64> {
        let thrusts = &self.thrusts.inverse * effort.fixed_rows::<6>(0);
        let over = |k: usize| if self.torques[k] > 0.0 { effort[6 + k] / self.torques[k] } else { 0.0 };
        DVector::from_iterator(self.inputs(), thrusts.iter().copied().chain((0..self.joints).map(over)))
    }
}

/// The nominal model from the present on.
pub struct TrackingModel<'a> {
    /// Entries of states and inputs.
    pub layout: &'a PlanLayout,
    /// The model.
    pub model: &'a NominalModel,
    pub(super) bank: &'a MotionBank,
    /// The present, and the equations of motion there.
    pub(super) estimate: &'a MotionEstimate,
    pub(super) equations: &'a Equations,
    /// Mean twist of the reference in each control period.
    pub(super) rates: &'a [Vector6<f64>],
}

impl TrackingModel<'_> {
    /// The present state.
    pub fn present(&self) -> DVector<f64> {
        self.pack(&self.estimate.now, &self.estimate.wrench)
    }

    /// Effort that holds the present velocities against the model's forces and the disturbance.
    pub fn holding_effort(&self) -> Velocities {
        self.equations.bias - self.estimate.disturbance
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
    ///
    /// The acceleration a solves `(M + T D) a + h = f`: its derivatives follow from the derivatives of the left side.
    pub fn dynamics(&self) -> DMatrix<f64> {
        let (layout, predictor, now) = (self.layout, &self.bank.predictor, &self.estimate.now);
        let (n, s, period) = (layout.joints, layout.states(), predictor.period);
        let [end, mean_gap] = predictor.lag;
        let hold = self.holding_effort();
        let effort = layout.effort(&layout.relative(&hold));
        let mut force = effort - hold;
        for k in 0..6 {
            force[k] += (self.estimate.wrench[k] - effort[k]) * mean_gap;
        }
        let acceleration = self.equations.solve(&force);
        let mean = now.velocities + acceleration * (0.5 * period);
        let by_state = self.model.force_derivatives(now.chain(), &acceleration, period);
        let by_joint = self.model.twist_derivatives(ChainState { velocities: &mean, ..now.chain() });
        let omega = mean.fixed_rows::<3>(3).into_owned();
        let mut dynamics = DMatrix::identity(s, s + layout.inputs());
        for z in 6..s + layout.inputs() {
            // The change of state and effort, and of the force that accelerates.
            let (mut x, mut effort) = (DVector::zeros(s), Velocities::zeros());
            let mut force = Velocities::zeros();
            if z < s {
                x[z] = 1.0;
            } else {
                let mut inputs = DVector::zeros(layout.inputs());
                inputs[z - s] = 1.0;
                effort = layout.effort(&inputs);
                force = effort;
            }
            if z < layout.thrust() {
                force = -by_state[z - 6];
            }
            let (change, wrench) = self.unpack(0, &x);
            for k in 0..6 {
                force[k] += (wrench[k] - effort[k]) * mean_gap;
            }
            let acceleration = self.equations.solve(&force);
            let TrackingState { mut error, mut up, mut q, velocities, .. } = change;
            let twist: Velocities = velocities + acceleration * (0.5 * period);
            error += self.equations.twist(&twist) * period;
            for k in 0..n {
                error += by_joint[k] * (q[k] * period);
                q[k] += twist[6 + k] * period;
            }
            up += (up.cross(&omega) + now.up.cross(&twist.fixed_rows::<3>(3))) * period;
            let wrench = effort.fixed_rows::<6>(0) + (wrench - effort.fixed_rows::<6>(0)) * end;
            let velocities = velocities + acceleration * period;
            dynamics.set_column(z, &self.pack(&TrackingState { error, up, q, velocities, ..now.clone() }, &wrench));
        }
        dynamics
    }

    /// State a control period later.
    fn advance(
        &self,
        equations: &Equations,
        (mut state, mut wrench): (TrackingState, Vector6<f64>),
        inputs: &DVector<f64>,
    ) -> DVector<f64> {
        let forces = [&self.layout.effort(inputs), &self.estimate.disturbance];
        self.bank.predictor.advance(equations, (&mut state, &mut wrench), forces, 0.0);
        self.pack(&state, &wrench)
    }
}

impl PlanModel for TrackingModel<'_> {
    fn step(&self, knot: usize, x: &DVector<f64>, inputs: &DVector<f64>) -> DVector<f64> {
        let from = self.unpack(knot, x);
        self.advance(&self.bank.predictor.equations(self.model, &from.0), from, inputs)
    }
}

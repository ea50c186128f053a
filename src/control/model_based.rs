//! Controllers on a disturbance observer's estimate: DOB with one observer or a bank of them, computed torque, MPC and NMPC.

use nalgebra::DVector;

use super::controller::{Controller, Plant, Widths};
use super::dob::{Dob, FeedbackGains};
use super::indices::ModelIndices;
use super::likelihood::Likelihood;
use super::mpc::{self, Mpc, MpcGains};
use super::multiple_model::{AdaptiveGains, ObserverBank};
use super::nmpc::NmpcGains;
use super::nmpc::vehicle::{Present, VehicleNmpc};
use super::observer::ObserverGains;
use super::rows::{
    LaneLaw, WIDEST, Work, achieved_wrench, arm_of, lanes_of, load, read, reset_diverged, rows_of, store, write_actions,
};
use super::{ActionMap, Actuation};
use crate::dynamics::CompositeBody;
use crate::error::ControlError;
use crate::lane::Lane;
use crate::lie::Vector6;
use crate::spatial::SpatialInertia;

/// Control law, by its gains.
#[derive(Debug, Clone, PartialEq)]
pub enum LawGains {
    /// PD with a disturbance observer.
    Dob(FeedbackGains),
    /// The same on a bank of observers.
    Adaptive(AdaptiveGains),
    /// Computed torque.
    ComputedTorque(FeedbackGains),
    /// Model-predictive control.
    Mpc(MpcGains),
    /// Nonlinear model-predictive control.
    Nmpc(NmpcGains),
}

/// Control law on an estimate.
#[derive(Debug, Clone, PartialEq)]
enum Law {
    /// One per model.
    Dob(Vec<Dob>),
    ComputedTorque(Dob),
    Mpc(Box<Mpc>),
    Nmpc(Box<VehicleNmpc>),
}

impl Law {
    /// Number of composite bodies that it needs: at the estimate, and a control period later.
    fn bodies(&self) -> usize {
        if let Law::Dob(_) = self { 1 } else { 2 }
    }

    /// Numbers of memory per instance, after the bank's.
    fn memory(&self) -> usize {
        if let Law::Nmpc(nmpc) = self { nmpc.memory() } else { 0 }
    }
}

/// A controller with a model: a bank of observers, mostly one, and a control law.
///
/// One kernel for all laws: compile time goes into the observer, which is then instantiated once per instruction set.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelBased {
    law: Law,
    indices: ModelIndices,
    bank: ObserverBank,
    actions: ActionMap,
    actuation: Actuation<f64>,
}

impl ModelBased {
    /// For checked gains.
    pub fn new(gains: LawGains, indices: ModelIndices, plant: Plant) -> Self {
        let Plant { scene, actions, period } = plant;
        let (mut models, mut likelihood) = (Vec::new(), Likelihood::none());
        let mut add =
            |observer: ObserverGains| models.push((FeedbackGains { observer, ..FeedbackGains::default() }, 1.0));
        match &gains {
            LawGains::Mpc(gains) => add(gains.observer),
            LawGains::Nmpc(gains) => add(gains.observer()),
            LawGains::Dob(gains) | LawGains::ComputedTorque(gains) => models.push((gains.clone(), 1.0)),
            LawGains::Adaptive(gains) => (models, likelihood) = (gains.models(period), gains.likelihood(period)),
        }
        let bank = ObserverBank::new(&models, likelihood, scene, period);
        let observer = bank.observer();
        let law = match gains {
            LawGains::Dob(_) | LawGains::Adaptive(_) => {
                Law::Dob(models.iter().map(|(gains, _)| Dob::new(gains, observer)).collect())
            }
            LawGains::ComputedTorque(gains) => Law::ComputedTorque(Dob::new(&gains, observer)),
            LawGains::Mpc(gains) => Law::Mpc(Box::new(Mpc::new(&gains, scene, observer, &actions))),
            LawGains::Nmpc(gains) => Law::Nmpc(Box::new(VehicleNmpc::new(&gains, scene, observer, &actions))),
        };
        Self { law, indices, bank, actuation: Actuation::new(&actions), actions }
    }
}

impl Controller for ModelBased {
    fn widths(&self) -> Widths {
        let memory = self.bank.memory() + self.law.memory();
        Widths { observation: self.indices.vehicle.width, memory, action: self.actions.len() }
    }

    fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        let mut layout = self.bank.memory_layout();
        if self.law.memory() > 0 {
            layout.push(("plan", self.law.memory()));
        }
        layout
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.act_in_lanes(observations, memory, actions)
    }
}

impl LaneLaw for ModelBased {
    #[inline(always)]
    fn control<L: Lane<Real = f64>>(
        &self,
        observations: &[f32],
        remembered: &mut [f64],
        actions: &mut [f32],
        work: &mut Work<L>,
    ) {
        let Self { law, indices, bank, actions: map, actuation } = self;
        let (nominal, period) = (bank.observer().model(), bank.observer().period());
        let Widths { observation, memory: width, .. } = self.widths();
        let lanes = observations.len() / observation;
        let Work { scratch, memory, wrenches } = work;
        memory.resize(bank.memory(), L::zero());
        wrenches.resize(bank.len(), Vector6::zero());
        load(remembered, width, memory);
        let measured = read::<L>(indices, observations);
        for model in 0..bank.len() {
            let estimate = bank.observe(model, &measured, memory, scratch);
            let zero = Vector6::zero();
            let mut bodies = [CompositeBody { inertia: SpatialInertia::zero(), momentum: zero, force: zero }; 2];
            for k in 0..law.bodies() {
                bodies[k] = nominal.composite_body(&estimate.motion, &estimate.arms[k], scratch);
            }
            wrenches[model] = match law {
                Law::Dob(dobs) => dobs[model].wrench(&estimate, &bodies[0]),
                Law::ComputedTorque(dob) => dob.computed_torque(&estimate, &bodies, period),
                Law::Mpc(mpc) => {
                    let parameters = rows_of(&mpc::parameters(&estimate, &bodies, period));
                    let mut plans = [[0.0; 6]; WIDEST];
                    for lane in 0..lanes {
                        let parameters = DVector::from_column_slice(parameters[lane].as_flattened());
                        plans[lane] = mpc.plan(&parameters).into();
                    }
                    lanes_of(&plans)
                }
                Law::Nmpc(nmpc) => {
                    let parameters = rows_of(&mpc::parameters(&estimate, &bodies, period));
                    let slow = rows_of(&[estimate.disturbance.slow.to_array()]);
                    let mut plans = [[0.0; 6]; WIDEST];
                    for (lane, plan) in remembered.chunks_exact_mut(width).enumerate() {
                        let [error, twist, thrust, _, steady, wave, rate] = parameters[lane];
                        let present = Present {
                            state: [error, twist, thrust],
                            wrenches: [slow[lane][0], wave, rate, steady],
                            arms: [arm_of(&estimate.arms[0], lane), arm_of(&estimate.arms[1], lane)],
                        };
                        plans[lane] = nmpc.plan(&present, &mut plan[bank.memory()..]);
                    }
                    lanes_of(&plans)
                }
            };
        }
        write_actions(map, bank.mix(wrenches, memory), actions);
        bank.remember(&measured, achieved_wrench(actuation, actions), memory);
        store(memory, remembered, width);
        reset_diverged(remembered, width);
    }
}

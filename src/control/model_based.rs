//! Controllers on a disturbance observer's estimate: DOB with one observer or a bank of them, computed torque, MPC and NMPC.

use nalgebra::DVector;

use super::bank::Bank;
use super::controller::{Controller, Plant, Widths};
use super::dob::{Dob, FeedbackGains};
use super::indices::ModelIndices;
use super::mpc::{self, Mpc, MpcGains, PARAMETERS};
use super::nmpc::NmpcGains;
use super::nmpc::vehicle::{PlanStart, VehicleNmpc};
use super::observer::ObserverGains;
use super::observer_bank::{AdaptiveGains, ObserverBank};
use super::rows::{
    LaneLaw, WIDEST, Work, achieved, arm_of, lanes_of, load, read, reset_diverged, rows_of, store, write_actions,
};
use super::thruster_fault::{FaultGains, ThrusterFaults};
use super::{ActionMap, Actuation, THRUSTERS};
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
    faults: Option<ThrusterFaults>,
    actions: ActionMap,
    actuation: Actuation<f64>,
}

impl ModelBased {
    /// For checked gains of a law and of the detection of a lost thruster.
    ///
    /// # Errors
    /// `ControlError` of an allocation without one of the thrusters.
    pub fn new(gains: LawGains, fault: FaultGains, indices: ModelIndices, plant: Plant) -> Result<Self, ControlError> {
        let Plant { scene, actions, period } = plant;
        let allocation = actions.allocation();
        let faults =
            (fault.fault_threshold > 0.0).then(|| ThrusterFaults::new(fault, &scene.vehicle, allocation, period));
        let faults = faults.transpose()?;
        let observing = |observer: ObserverGains| FeedbackGains { observer, ..FeedbackGains::default() };
        let mut models = match &gains {
            LawGains::Dob(gains) | LawGains::ComputedTorque(gains) => vec![gains.clone()],
            LawGains::Adaptive(gains) => gains.models(&gains.bank(period), period),
            LawGains::Mpc(gains) => vec![observing(gains.observer)],
            LawGains::Nmpc(gains) => vec![observing(gains.observer())],
        };
        let bank = if let LawGains::Adaptive(gains) = &gains {
            gains.bank(period)
        } else {
            let delay = models[0].observer.delay;
            models.extend(faults.iter().flat_map(|faults| faults.observers(delay)));
            Bank::alike(delay, models.len())
        };
        let bank = ObserverBank::new(bank, &models, scene, period);
        let observer = bank.observer();
        let law = match gains {
            LawGains::Dob(_) | LawGains::Adaptive(_) => {
                Law::Dob(models.iter().map(|gains| Dob::new(gains, observer)).collect())
            }
            LawGains::ComputedTorque(gains) => Law::ComputedTorque(Dob::new(&gains, observer)),
            LawGains::Mpc(gains) => Law::Mpc(Box::new(Mpc::new(&gains, scene, observer, &actions))),
            LawGains::Nmpc(gains) => Law::Nmpc(Box::new(VehicleNmpc::new(&gains, scene, observer, &actions))),
        };
        Ok(Self { law, indices, bank, faults, actuation: Actuation::new(&actions), actions })
    }

    /// Numbers of memory per instance before the plan's.
    fn observed(&self) -> usize {
        self.bank.memory() + self.faults.as_ref().map_or(0, ThrusterFaults::memory)
    }
}

impl Controller for ModelBased {
    fn widths(&self) -> Widths {
        let memory = self.observed() + self.law.memory();
        Widths { observation: self.indices.vehicle.width, memory, action: self.actions.len() }
    }

    fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        let mut layout = self.bank.memory_layout();
        layout.extend(self.faults.iter().flat_map(ThrusterFaults::memory_layout));
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
        let Self { law, indices, bank, faults, actions: map, actuation } = self;
        let (nominal, period) = (bank.observer().model(), bank.observer().period());
        let (width, of_bank, observed) = (self.widths().memory, bank.memory(), self.observed());
        let Work { scratch, memory, wrenches } = work;
        memory.resize(observed, L::zero());
        wrenches.resize(bank.len(), Vector6::zero());
        load(remembered, width, memory);
        let measured = read::<L>(indices, observations);
        let (mut present, mut innovation, mut differences) = (None, Vector6::zero(), [Vector6::zero(); THRUSTERS]);
        for model in 0..bank.len() {
            let mut estimate = bank.observe(model, &measured, &mut memory[..of_bank], scratch);
            if let Some(faults) = faults {
                match model {
                    0 => present = Some(estimate),
                    1 => innovation = estimate.innovation,
                    _ => differences[model - 2] = estimate.innovation - innovation,
                }
                if model + 1 < bank.len() {
                    continue;
                }
                let predicted = bank.predicted(&memory[..of_bank]);
                faults.decide(innovation, &differences, predicted, &mut memory[of_bank..]);
                if let Some(present) = present {
                    estimate = present;
                }
            }
            let zero = Vector6::zero();
            let mut bodies = [CompositeBody { inertia: SpatialInertia::zero(), momentum: zero, force: zero }; 2];
            for k in 0..law.bodies() {
                bodies[k] = nominal.composite_body(&estimate.motion, &estimate.arms[k], scratch);
            }
            let law_of = if faults.is_some() { 0 } else { model };
            wrenches[law_of] = match law {
                Law::Dob(dobs) => dobs[law_of].wrench(&estimate, &bodies[0]),
                Law::ComputedTorque(dob) => dob.computed_torque(&estimate, &bodies, period),
                Law::Mpc(_) | Law::Nmpc(_) => {
                    let parameters = rows_of(&mpc::parameters(&estimate, &bodies, period));
                    let mut plans = [[0.0; 6]; WIDEST];
                    for (lane, row) in remembered.chunks_exact_mut(width).enumerate() {
                        let all = &parameters[lane];
                        if let Law::Mpc(mpc) = law {
                            let parameters = DVector::from_column_slice(&all.as_flattened()[..PARAMETERS]);
                            plans[lane] = mpc.plan(&parameters).into();
                        } else if let Law::Nmpc(nmpc) = law {
                            let [error, twist, thrust, _, steady, wave, rate, slow] = *all;
                            let arms = [arm_of(&estimate.arms[0], lane), arm_of(&estimate.arms[1], lane)];
                            let (state, wrenches) = ([error, twist, thrust], [slow, wave, rate, steady]);
                            let lost = match faults {
                                Some(faults) => faults.irreplaceable(&row[of_bank..]),
                                None => None,
                            };
                            plans[lane] = nmpc.plan(&PlanStart { state, wrenches, arms }, lost, &mut row[observed..]);
                        }
                    }
                    lanes_of(&plans)
                }
            };
        }
        let mut wrench = bank.mix(wrenches, &mut memory[..of_bank]);
        if let Some(faults) = faults {
            wrench = faults.demand(wrench, &memory[of_bank..]);
        }
        write_actions(map, wrench, actions);
        let acted = achieved::<L>(actuation, actions);
        for model in 0..bank.len() {
            let command = match faults {
                Some(faults) => faults.wrench(model, &acted, &memory[of_bank..]),
                None => acted.wrench,
            };
            bank.remember(model, &measured, command, &mut memory[..of_bank]);
        }
        store(memory, remembered, width);
        reset_diverged(remembered, width);
    }
}

//! Controllers on a disturbance observer's estimate: DOB with one observer or a bank of them, computed torque, MPC and NMPC.

use nalgebra::DVector;
use serde::Serialize;

use super::controller::{Controller, Widths};
use super::dob::{Dob, FeedbackGains};
use super::gains::{self, GainMap, MAX_DELAY, MAX_SENSOR_DELAY};
use super::indices::ModelIndices;
use super::mpc::{self, Mpc, MpcGains};
use super::multiple_model::{AdaptiveGains, ObserverBank};
use super::nmpc::NmpcGains;
use super::nmpc::vehicle::{Present, VehicleNmpc};
use super::observer::Observer;
use super::rows::{
    WIDEST, achieved_wrench, arm_of, lanes_of, load, read, reset_diverged, rows_of, store, write_actions,
};
use super::{ActionMap, Actuation};
use crate::description::Scene;
use crate::dynamics::CompositeBody;
use crate::dynamics::aba::Scratch;
use crate::error::ControlError;
use crate::lane::{Isa, Kernel, Lane, Real};
use crate::lie::Vector6;
use crate::limits::interrupt;
use crate::spatial::SpatialInertia;

/// Control law, by its gains.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
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
    Dob(Dob),
    /// One per model.
    Adaptive(AdaptiveGains, Vec<Dob>),
    ComputedTorque(Dob),
    Mpc(Box<Mpc>),
    Nmpc(Box<VehicleNmpc>),
}

impl Law {
    /// Number of composite bodies that it needs: at the estimate, and a control period later.
    fn bodies(&self) -> usize {
        match self {
            Law::Dob(_) | Law::Adaptive(..) => 1,
            Law::ComputedTorque(_) | Law::Mpc(_) | Law::Nmpc(_) => 2,
        }
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
    /// For a checked scene, acting every `period` s.
    ///
    /// # Errors
    /// `ControlError` for a gain that is not finite or is negative; for a delay beyond [`MAX_SENSOR_DELAY`],
    /// on a bank and for NMPC beyond [`MAX_DELAY`]; for a prediction horizon beyond 10 s; on a bank, for a factor
    /// or a deviation of 0.
    pub fn new(
        gains: LawGains,
        indices: ModelIndices,
        scene: &Scene,
        actions: ActionMap,
        period: f64,
    ) -> Result<Self, ControlError> {
        gains::check(&gains)?;
        let (observer, horizon, max_delay) = match &gains {
            LawGains::Dob(FeedbackGains { observer, prediction_horizon, .. })
            | LawGains::ComputedTorque(FeedbackGains { observer, prediction_horizon, .. }) => {
                (*observer, *prediction_horizon, MAX_SENSOR_DELAY)
            }
            LawGains::Adaptive(AdaptiveGains { feedback, .. }) => {
                (feedback.observer, feedback.prediction_horizon, MAX_DELAY)
            }
            LawGains::Mpc(gains) => (gains.observer, 0.0, MAX_SENSOR_DELAY),
            LawGains::Nmpc(gains) => (gains.observer(), 0.0, MAX_DELAY),
        };
        gains::check_delay(observer.delay, max_delay)?;
        gains::check_horizon(horizon)?;
        let bank = match &gains {
            LawGains::Adaptive(gains) => {
                gains.check()?;
                ObserverBank::new(gains, scene, period)
            }
            _ => ObserverBank::of(Observer::new(observer, horizon, scene, period)),
        };
        let observer = bank.observer();
        let law = match gains {
            LawGains::Dob(gains) => Law::Dob(Dob::new(gains, observer)),
            LawGains::Adaptive(gains) => {
                let laws = gains.models(period).into_iter().map(|(gains, _)| Dob::new(gains, observer)).collect();
                Law::Adaptive(gains, laws)
            }
            LawGains::ComputedTorque(gains) => Law::ComputedTorque(Dob::new(gains, observer)),
            LawGains::Mpc(gains) => Law::Mpc(Box::new(Mpc::new(gains, scene, observer, &actions))),
            LawGains::Nmpc(gains) => Law::Nmpc(Box::new(VehicleNmpc::new(gains, scene, observer, &actions))),
        };
        Ok(Self { law, indices, bank, actuation: Actuation::new(&actions), actions })
    }
}

impl Controller for ModelBased {
    fn widths(&self) -> Widths {
        let memory = self.bank.memory() + self.law.memory();
        Widths { observation: self.indices.vehicle.width, memory, action: self.actions.len() }
    }

    fn gains(&self) -> GainMap {
        match &self.law {
            Law::Dob(dob) | Law::ComputedTorque(dob) => gains::to_map(dob.gains()),
            Law::Adaptive(gains, _) => gains::to_map(gains),
            Law::Mpc(mpc) => gains::to_map(mpc.gains()),
            Law::Nmpc(nmpc) => gains::to_map(nmpc.gains()),
        }
    }

    fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        let mut layout = self.bank.memory_layout();
        if self.law.memory() > 0 {
            layout.push(("plan", self.law.memory()));
        }
        layout
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().rows(observations, memory, actions)?;
        f64::dispatch(Isa::best().unwrap_or(Isa::Plain), &mut Rows { control: self, observations, memory, actions });
        Ok(())
    }
}

struct Rows<'a> {
    control: &'a ModelBased,
    observations: &'a [f32],
    memory: &'a mut [f64],
    actions: &'a mut [f32],
}

impl Kernel<f64> for Rows<'_> {
    #[inline(always)]
    fn run<L: Lane<Real = f64>>(&mut self) {
        let ModelBased { law, indices, bank, actions: map, actuation } = self.control;
        let Widths { observation, memory: width, action } = self.control.widths();
        let mut scratch = Scratch::new();
        let mut memory = vec![L::zero(); bank.memory()];
        let mut wrenches = vec![Vector6::zero(); bank.len()];
        let (nominal, period) = (bank.observer().model(), bank.observer().period());
        let count = self.observations.len() / observation;
        for first in (0..count).step_by(L::LANES) {
            if interrupt::requested() {
                break;
            }
            let lanes = L::LANES.min(count - first);
            let rows = &self.observations[first * observation..][..lanes * observation];
            let remembered = &mut self.memory[first * width..][..lanes * width];
            let actions = &mut self.actions[first * action..][..lanes * action];
            load(remembered, width, &mut memory);
            let measured = read::<L>(indices, rows);
            for model in 0..bank.len() {
                let estimate = bank.observe(model, &measured, &mut memory, &mut scratch);
                let mut bodies = [CompositeBody {
                    inertia: SpatialInertia::zero(),
                    momentum: Vector6::zero(),
                    force: Vector6::zero(),
                }; 2];
                for k in 0..law.bodies() {
                    bodies[k] = nominal.composite_body(&estimate.motion, &estimate.arms[k], &mut scratch);
                }
                wrenches[model] = match law {
                    Law::Dob(dob) => dob.wrench(&estimate, &bodies[0]),
                    Law::Adaptive(_, laws) => laws[model].wrench(&estimate, &bodies[0]),
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
            write_actions(map, bank.mix(&wrenches, &mut memory), actions);
            bank.remember(&measured, achieved_wrench(actuation, actions), &mut memory);
            store(&memory, remembered, width);
            reset_diverged(remembered, width);
        }
    }
}

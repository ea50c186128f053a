//! Feedback on what an observer tells: a PD whose disturbance is compensated, and computed torque.

use super::filter::Swell;
use super::observer::{Estimate, Observer, Observing};
use super::rows::{ModelIndices, forget, load, reached, store, write};
use crate::control::pd::check_gains;
use crate::control::{ActionMap, Actuation, Controller, Widths};
use crate::description::Scene;
use crate::dynamics::aba::Scratch;
use crate::error::ControlError;
use crate::lane::{Isa, Kernel, Lane, Real};
use crate::lie::Vector6;

/// How the wrench follows from the estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Law {
    /// A PD on wrenches that compensates force and disturbance: `F = -kp e - kd V - f - d`.
    Disturbance,
    /// Inverse dynamics: `F = M a + (h(q^+, q'^+) - h(q, q')) / T + V x* h - f - d` with `a = -kp e - kd V`, and h at the arm's
    /// references for the next control instant. `[HC eq. 13]`
    ComputedTorque,
}

/// Gains of [`ModelControl`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelGains {
    /// Proportional gains: N/m and N m/rad, or 1/s2 for computed torque.
    pub kp: [f64; 6],
    /// Derivative gains: N s/m and N m s/rad, or 1/s.
    pub kd: [f64; 6],
    /// What it observes by.
    pub observing: Observing,
    /// Time beyond the present for which the model goes on before the feedback, s: what thrusters lag.
    pub lead: f64,
}

/// Feedback on an observer's estimate.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelControl {
    law: Law,
    gains: ModelGains,
    reading: ModelIndices,
    observer: Observer,
    /// From now to when a command acts.
    acting: Swell,
    actions: ActionMap,
    actuation: Actuation<f64>,
}

impl ModelControl {
    /// For a checked scene, acting every `period` s.
    ///
    /// # Errors
    /// `ControlError::Gain` for a gain that is not finite or is negative.
    pub fn new(
        law: Law,
        gains: ModelGains,
        reading: ModelIndices,
        scene: &Scene,
        actions: ActionMap,
        period: f64,
    ) -> Result<Self, ControlError> {
        check_gains("kp", &gains.kp)?;
        check_gains("kd", &gains.kd)?;
        let observer = Observer::new(gains.observing, gains.lead, scene, period)?;
        Ok(Self {
            law,
            gains,
            reading,
            // What is asked for acts half a period and a lag later.
            acting: Swell::over(gains.observing.frequency, 0.5 * period + observer.plant().lag()),
            observer,
            actuation: Actuation::new(&actions),
            actions,
        })
    }

    /// Gains in use.
    pub fn gains(&self) -> &ModelGains {
        &self.gains
    }

    /// Wrench for an estimate.
    #[inline(always)]
    fn wrench<L: Lane<Real = f64>>(&self, at: &Estimate<L>, scratch: &mut Scratch<L>) -> Vector6<L> {
        let Estimate { motion, arms, unexplained, .. } = *at;
        let (error, twist) = (motion.error.to_array(), motion.twist.to_array());
        let mut feedback = [L::zero(); 6];
        for k in 0..6 {
            let damped = L::c(self.gains.kd[k]) * twist[k];
            feedback[k] = -L::c(self.gains.kp[k]).mul_add(error[k], damped);
        }
        let feedback = Vector6::from_array(feedback);
        let [wave, _] = self.acting.after(unexplained.wave);
        let against = unexplained.drift + wave;
        let mut wrench = Vector6::zero();
        for (k, arm) in arms.iter().enumerate() {
            let here = self.observer.plant().whole(&motion, arm, scratch);
            wrench = match (self.law, k) {
                (Law::Disturbance, _) => return feedback - here.force - against,
                (Law::ComputedTorque, 0) => {
                    let held = here.momentum_transport(motion.twist) - here.force - against;
                    here.momentum.scale_add(L::c(-1.0 / self.observer.period()), here.inertia.apply(feedback) + held)
                }
                (Law::ComputedTorque, _) => here.momentum.scale_add(L::c(1.0 / self.observer.period()), wrench),
            };
        }
        wrench
    }
}

impl Controller for ModelControl {
    fn widths(&self) -> Widths {
        Widths { observation: self.reading.vehicle.width, memory: self.observer.memory(), action: self.actions.len() }
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().rows(observations, memory, actions)?;
        f64::dispatch(Isa::best().unwrap_or(Isa::Plain), &mut Rows { control: self, observations, memory, actions });
        Ok(())
    }
}

struct Rows<'a> {
    control: &'a ModelControl,
    observations: &'a [f32],
    memory: &'a mut [f64],
    actions: &'a mut [f32],
}

impl Kernel<f64> for Rows<'_> {
    #[inline(always)]
    fn run<L: Lane<Real = f64>>(&mut self) {
        let ModelControl { observer, reading, actions: map, actuation, .. } = self.control;
        let Widths { observation, memory: width, action } = self.control.widths();
        let mut scratch = Scratch::new();
        let mut memory = vec![L::zero(); width];
        let groups = self.observations.chunks(L::LANES * observation);
        let groups =
            groups.zip(self.memory.chunks_mut(L::LANES * width)).zip(self.actions.chunks_mut(L::LANES * action));
        for ((rows, remembered), actions) in groups {
            load(remembered, width, &mut memory);
            let seen = reading.read::<L>(rows);
            let estimate = observer.observe(&seen, &mut memory, &mut scratch);
            write(map, self.control.wrench(&estimate, &mut scratch), actions);
            observer.remember(&seen, reached(actuation, actions), &mut memory);
            store(&memory, remembered, width);
            forget(remembered, width);
        }
    }
}

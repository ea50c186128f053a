//! Multiple-model estimation: a bank of observers, weighed by the likelihood of their innovations. `[Mag65]`

use serde::{Deserialize, Serialize};

use super::bank::{Bank, BankModel, normalise};
use super::dob::FeedbackGains;
use super::nominal_model::ArmState;
use super::observer::{Observer, ObserverEstimate, ObserverGains};
use super::rows::MeasuredMotion;
use crate::description::{Scene, VehicleServo};
use crate::dynamics::aba::Scratch;
use crate::lane::{Lane, exp};
use crate::lie::Vector6;

/// Gains of the adaptive DOB; pairs are linear and angular.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AdaptiveGains {
    /// Gains of each model's DOB without delay. `delay` is the maximum of the bank, which begins at 0.
    #[serde(flatten)]
    pub feedback: FeedbackGains,
    /// Decrease of `kp` and of `kd` with a model's delay tau: gains over `1 + a tau`, 1/s.
    pub delay_schedule: [f64; 2],
    /// Motion per command over the nominal model's.
    pub thrust_factors: [f64; 3],
    /// Standard deviation of innovations of the twist, m/s and rad/s.
    pub innovation: [f64; 2],
    /// Standard deviation of joints' coordinates and rates about the reference, rad and rad/s, or m and m/s.
    pub joint_innovation: [f64; 2],
    /// Time constant of forgetting, s; 0: none.
    pub memory_time: f64,
}

impl Default for AdaptiveGains {
    fn default() -> Self {
        Self::new(VehicleServo::default(), 0)
    }
}

impl AdaptiveGains {
    /// Default gains, with these of a PD, for measurements up to `delay` control periods old.
    pub fn new(servo: VehicleServo, delay: usize) -> Self {
        Self {
            feedback: FeedbackGains::new(servo, ObserverGains { delay, ..ObserverGains::default() }),
            delay_schedule: [3.0, 1.0],
            thrust_factors: [0.5, 1.0, 2.0],
            innovation: [0.1, 0.2],
            joint_innovation: [0.01, 0.05],
            memory_time: 10.0,
        }
    }

    /// Gains of the DOBs of a bank's models.
    pub(super) fn models(&self, bank: &Bank<4>, period: f64) -> Vec<FeedbackGains> {
        let gains = |model: &BankModel| {
            let mut gains = self.feedback.clone();
            gains.observer.delay = model.delay;
            let [p, d] = self.delay_schedule.map(|a| 1.0 / (1.0 + a * model.delay as f64 * period));
            (gains.kp, gains.kd) = (gains.kp.map(|k| k * p), gains.kd.map(|k| k * d));
            gains
        };
        bank.models.iter().map(gains).collect()
    }

    pub(super) fn bank(&self, period: f64) -> Bank<4> {
        let ([v, w], [q, qd]) = (self.innovation, self.joint_innovation);
        let times = [self.memory_time, period];
        Bank::new(self.feedback.observer.delay, self.thrust_factors, [v, w, q, qd], times)
    }
}

/// Bank of observers.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ObserverBank {
    /// Innovations: of the twist, linear and angular; of joints' coordinates and rates.
    bank: Bank<4>,
    /// Each with its place in a row of memory.
    observers: Vec<(Observer, usize)>,
}

impl ObserverBank {
    /// For gains by model, and a checked scene that is measured and acted on every `period` s.
    pub fn new(bank: Bank<4>, gains: &[FeedbackGains], scene: &Scene, period: f64) -> Self {
        let (mut place, mut observers): (_, Vec<(Observer, usize)>) = (bank.weights(), Vec::new());
        let mut before = None;
        for gains in gains {
            let observer = match observers.last() {
                Some((last, _)) if before == Some(gains.observer) => last.clone(),
                _ => Observer::new(gains.observer, gains.prediction_horizon, scene, period),
            };
            let width = observer.memory();
            observers.push((observer, place));
            place += width;
            before = Some(gains.observer);
        }
        Self { bank, observers }
    }

    pub fn len(&self) -> usize {
        self.observers.len()
    }

    /// Observer with the maximum delay, and its place in a row of memory.
    fn last(&self) -> &(Observer, usize) {
        &self.observers[self.len() - 1]
    }

    /// Observer with the maximum delay.
    pub fn observer(&self) -> &Observer {
        &self.last().0
    }

    /// Numbers of memory per instance.
    pub fn memory(&self) -> usize {
        let (observer, place) = self.last();
        place + observer.memory()
    }

    /// Names and lengths of the blocks of memory.
    pub fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        match self.len() {
            _ if self.bank.weights() == 0 => {
                let first = self.observer().memory_layout();
                let others = self.memory() - self.observer().memory();
                first.into_iter().chain((others > 0).then_some(("fault_observers", others))).collect()
            }
            n => vec![("log_weights", n), ("models", self.memory() - n)],
        }
    }

    /// Updates a model's estimate and its weight by a measurement, and predicts the present. Weights wait until all
    /// models have predictions of measurements.
    #[inline(always)]
    pub fn observe<L: Lane<Real = f64>>(
        &self,
        k: usize,
        measured: &MeasuredMotion<L>,
        memory: &mut [L],
        scratch: &mut Scratch<L>,
    ) -> ObserverEstimate<L> {
        let (observer, place) = &self.observers[k];
        let estimate = observer.observe(measured, &mut memory[*place..][..observer.memory()], scratch);
        if self.bank.weights() > 0 {
            let gain =
                L::select(self.predicted(memory), self.log_likelihood(&estimate, observer.model().joints()), L::zero());
            self.bank.update(&mut memory[k], gain);
        }
        estimate
    }

    /// Log-likelihood of innovations, up to what all models share.
    #[inline(always)]
    fn log_likelihood<L: Lane<Real = f64>>(&self, at: &ObserverEstimate<L>, joints: usize) -> L {
        let [linear, angular, coordinate, rate] = self.bank.precision;
        let Vector6 { linear: v, angular: w } = at.innovation;
        let ArmState { q, qd } = at.arm_innovation;
        let mut sum = v.dot(v).mul_add(L::c(linear), w.dot(w) * L::c(angular));
        for i in 0..joints {
            sum = (q[i] * q[i]).mul_add(L::c(coordinate), sum);
            sum = (qd[i] * qd[i]).mul_add(L::c(rate), sum);
        }
        -sum
    }

    /// Mean of the models' wrenches by their weights, over their factors on the thrust.
    #[inline(always)]
    pub fn mix<L: Lane<Real = f64>>(&self, wrenches: &[Vector6<L>], memory: &mut [L]) -> Vector6<L> {
        if self.bank.weights() == 0 {
            return wrenches[0];
        }
        normalise(&mut memory[..self.len()]);
        let (mut total, mut sum) = (L::zero(), Vector6::zero());
        for k in 0..self.len() {
            let weight = exp(memory[k]);
            total += weight;
            sum = wrenches[k].scale_add(weight * L::c(1.0 / self.bank.models[k].thrust), sum);
        }
        sum.scale(L::c(1.0) / total)
    }

    /// True where all models have predictions of measurements.
    #[inline(always)]
    pub fn predicted<L: Lane<Real = f64>>(&self, memory: &[L]) -> L::Mask {
        let (last, place) = self.last();
        L::c(self.bank.delay() as f64).lt(last.periods(&memory[*place..]))
    }

    /// Stores a model's commanded wrench and the arm's reference.
    #[inline(always)]
    pub fn remember<L: Lane<Real = f64>>(
        &self,
        k: usize,
        measured: &MeasuredMotion<L>,
        command: Vector6<L>,
        memory: &mut [L],
    ) {
        let (observer, place) = &self.observers[k];
        let command = command.scale(L::c(self.bank.models[k].thrust));
        observer.remember(measured, command, &mut memory[*place..][..observer.memory()]);
    }
}

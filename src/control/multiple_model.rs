//! Multiple-model estimation: a bank of observers, weighed by the likelihood of their innovations. `[Mag65]`

use serde::{Deserialize, Serialize};

use super::dob::FeedbackGains;
use super::likelihood::{Likelihood, normalise};
use super::nominal_model::ArmState;
use super::observer::{Estimate, Observer, ObserverGains};
use super::rows::Measurement;
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

    /// Gains of the models' DOBs: by delay, and by factor on the thrust.
    pub(super) fn models(&self, period: f64) -> Vec<(FeedbackGains, f64)> {
        let at_delay = |delay: usize| {
            let mut gains = self.feedback.clone();
            gains.observer.delay = delay;
            let [p, d] = self.delay_schedule.map(|a| 1.0 / (1.0 + a * delay as f64 * period));
            (gains.kp, gains.kd) = (gains.kp.map(|k| k * p), gains.kd.map(|k| k * d));
            gains
        };
        (0..=self.feedback.observer.delay)
            .flat_map(|delay| self.thrust_factors.map(|factor| (at_delay(delay), factor)))
            .collect()
    }

    /// Likelihood of innovations.
    pub(super) fn likelihood(&self, period: f64) -> Likelihood<4> {
        let ([v, w], [q, qd]) = (self.innovation, self.joint_innovation);
        Likelihood::new([v, w, q, qd], self.memory_time, period)
    }
}

/// Observer of a bank, its factor on the thrust, and its place in a row of memory.
#[derive(Debug, Clone, PartialEq)]
struct BankObserver {
    observer: Observer,
    thrust: f64,
    place: usize,
}

/// Bank of observers. A bank of one has no weights.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ObserverBank {
    models: Vec<BankObserver>,
    /// Likelihood of innovations: of the twist, linear and angular; of joints' coordinates and rates.
    likelihood: Likelihood<4>,
}

impl ObserverBank {
    /// For models by their gains, in ascending order of delay, and their factors on the thrust; for a checked scene that is
    /// measured and acted on every `period` s. `likelihood` is for several models.
    pub fn new(given: &[(FeedbackGains, f64)], likelihood: Likelihood<4>, scene: &Scene, period: f64) -> Self {
        let mut place = if given.len() > 1 { given.len() } else { 0 };
        let mut models: Vec<BankObserver> = Vec::with_capacity(given.len());
        for (gains, thrust) in given {
            let observer = match models.last() {
                Some(last) if last.observer.delay() == gains.observer.delay => last.observer.clone(),
                _ => Observer::new(gains.observer, gains.prediction_horizon, scene, period),
            };
            let width = observer.memory();
            models.push(BankObserver { observer, thrust: *thrust, place });
            place += width;
        }
        Self { models, likelihood }
    }

    /// Number of models.
    pub fn len(&self) -> usize {
        self.models.len()
    }

    /// The model with the maximum delay.
    fn last(&self) -> &BankObserver {
        &self.models[self.models.len() - 1]
    }

    /// Observer with the maximum delay.
    pub fn observer(&self) -> &Observer {
        &self.last().observer
    }

    /// Numbers of memory per instance.
    pub fn memory(&self) -> usize {
        self.last().place + self.observer().memory()
    }

    /// Names and lengths of the blocks of memory.
    pub fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        match self.len() {
            1 => self.observer().memory_layout(),
            n => vec![("log_weights", n), ("models", self.memory() - n)],
        }
    }

    /// Updates a model's estimate and its weight by a measurement, and predicts the present. Weights wait until all
    /// models have predictions of measurements.
    #[inline(always)]
    pub fn observe<L: Lane<Real = f64>>(
        &self,
        k: usize,
        measured: &Measurement<L>,
        memory: &mut [L],
        scratch: &mut Scratch<L>,
    ) -> Estimate<L> {
        let BankObserver { observer, place, .. } = &self.models[k];
        let estimate = observer.observe(measured, &mut memory[*place..][..observer.memory()], scratch);
        if self.len() > 1 {
            let predicted =
                L::c(self.observer().delay() as f64).lt(self.observer().periods(&memory[self.last().place..]));
            let gain = L::select(predicted, self.log_likelihood(&estimate, observer.model().joints()), L::zero());
            self.likelihood.update(&mut memory[k], gain);
        }
        estimate
    }

    /// Log-likelihood of innovations, up to what all models share.
    #[inline(always)]
    fn log_likelihood<L: Lane<Real = f64>>(&self, at: &Estimate<L>, joints: usize) -> L {
        let [linear, angular, coordinate, rate] = self.likelihood.precision;
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
        if self.len() == 1 {
            return wrenches[0];
        }
        normalise(&mut memory[..self.len()]);
        let (mut total, mut sum) = (L::zero(), Vector6::zero());
        for k in 0..self.len() {
            let weight = exp(memory[k]);
            total += weight;
            sum = wrenches[k].scale_add(weight * L::c(1.0 / self.models[k].thrust), sum);
        }
        sum.scale(L::c(1.0) / total)
    }

    /// Stores the commanded wrench and the arm's reference.
    #[inline(always)]
    pub fn remember<L: Lane<Real = f64>>(&self, measured: &Measurement<L>, command: Vector6<L>, memory: &mut [L]) {
        for BankObserver { observer, thrust, place } in &self.models {
            let memory = &mut memory[*place..][..observer.memory()];
            observer.remember(measured, command.scale(L::c(*thrust)), memory);
        }
    }
}

//! Bank of models of delay and thrust, each with its disturbance observer. `[Mag65]`

use nalgebra::Vector6;

use super::predictor::Predictor;
use super::reading::TrackingState;
use crate::control::bank::{Bank, BankModel, normalise};
use crate::control::equations::{Equations, Velocities};
use crate::control::nominal_model::NominalModel;
use crate::lane::exp;

/// Log weight, relative to the maximum, below which a model is ignored: its present is not predicted.
const NEGLIGIBLE: f64 = -7.0;

/// Models with a state each.
///
/// Terms of the equations of motion are evaluated along the prediction of the likeliest model, and serve all of them:
/// configurations are measured, and equal; velocities differ by corrections.
pub(in crate::control) struct MotionBank {
    /// Innovations: linear and angular velocities, rates of joints.
    bank: Bank<3>,
    pub predictor: Predictor,
    /// Velocities of vehicle and joints.
    size: usize,
}

/// Estimate under one model.
pub(in crate::control) struct MotionEstimate {
    /// The present; for a model without weight an earlier time.
    pub now: TrackingState,
    /// Weight over the maximum.
    weight: f64,
    /// Measured velocities minus predicted ones.
    innovation: Option<Velocities>,
    pub disturbance: Velocities,
    /// Wrench of the thrusters at the same time as `now`.
    pub wrench: Vector6<f64>,
    /// nu- and the wrench at the next measurement, where they are predicted already.
    next: Option<(Velocities, Vector6<f64>)>,
    /// Periods from the measurement's instant to the present.
    past: usize,
    /// Index of the terms at `now`.
    terms: usize,
}

/// Estimates of all models.
pub(in crate::control) struct MotionEstimates {
    models: Vec<MotionEstimate>,
    /// Terms at the measurement, and after each period since.
    terms: Vec<Equations>,
    leader: usize,
}

impl MotionEstimates {
    /// The likeliest model's estimate, and the terms at its present.
    pub fn likeliest(&self) -> (&MotionEstimate, &Equations) {
        let estimate = &self.models[self.leader];
        (estimate, &self.terms[estimate.terms])
    }
}

impl MotionBank {
    pub fn new(bank: Bank<3>, predictor: Predictor) -> Self {
        Self { bank, size: predictor.size, predictor }
    }

    /// Numbers of memory of a model.
    fn width(&self) -> usize {
        2 * self.size + 6
    }

    /// Numbers of memory per instance.
    pub fn memory(&self) -> usize {
        self.bank.weights() + 1 + self.bank.models.len() * self.width() + self.bank.delay() * self.size
    }

    /// Names and lengths of the blocks of memory.
    pub fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        let (n, efforts) = (self.size, ("efforts", self.bank.delay() * self.size));
        match self.bank.models.len() {
            1 => vec![("periods", 1), ("velocity", n), ("disturbance", n), ("thrust", 6), efforts],
            k => vec![("log_weights", k), ("periods", 1), ("models", k * self.width()), efforts],
        }
    }

    /// Parts of a row of memory: logarithms of weights; control periods so far, at most one more than the maximum delay; nu-, d
    /// and the wrench of the thrusters, per model; commanded efforts, the latest first.
    fn split<'a>(&self, memory: &'a mut [f64]) -> [&'a mut [f64]; 4] {
        let (logs, memory) = memory.split_at_mut(self.bank.weights());
        let (periods, memory) = memory.split_at_mut(1);
        let (states, efforts) = memory.split_at_mut(self.bank.models.len() * self.width());
        [logs, periods, states, efforts]
    }

    /// Updates estimates and weights by a measurement, and predicts from its instant to the present.
    pub fn estimate(&self, model: &NominalModel, measured: &TrackingState, memory: &mut [f64]) -> MotionEstimates {
        let [logs, periods, states, efforts] = self.split(memory);
        let periods = periods[0] as usize;
        let mut models: Vec<MotionEstimate> = (self.bank.models.iter().zip(states.chunks_exact(self.width())))
            .map(|(BankModel { delay, .. }, state)| self.correct(measured, state, *delay, periods))
            .collect();
        let leader = likeliest(logs);
        let mut terms = Vec::with_capacity(1 + self.bank.delay());
        terms.push(self.predictor.equations(model, &models[leader].now));
        for (estimate, state) in models.iter_mut().zip(states.chunks_exact_mut(self.width())) {
            let disturbance = &mut state[self.size..][..self.size];
            if let Some(innovation) = &estimate.innovation {
                self.predictor.disturb(&terms[0].force(innovation), disturbance);
            }
            estimate.disturbance = padded(disturbance);
        }
        if periods > self.bank.delay() && !logs.is_empty() {
            self.weigh(&mut models, logs);
        }
        let efforts: Vec<Velocities> = efforts.chunks_exact(self.size).map(padded).collect();
        self.predict(model, leader, &efforts, &mut models[leader], &mut terms, true);
        for k in (0..models.len()).filter(|k| *k != leader) {
            self.predict(model, k, &efforts, &mut models[k], &mut terms, false);
        }
        MotionEstimates { models, terms, leader: likeliest(logs) }
    }

    /// State at the measurement's instant, corrected by it if it was predicted.
    fn correct(&self, measured: &TrackingState, state: &[f64], delay: usize, periods: usize) -> MotionEstimate {
        let mut now = measured.clone();
        let innovation = (periods > delay).then(|| {
            let innovation = measured.velocities - padded(&state[..self.size]);
            self.predictor.correct(&state[..self.size], &innovation, &mut now.velocities);
            innovation
        });
        let wrench = Vector6::from_column_slice(&state[2 * self.size..][..6]);
        let (disturbance, past) = (Velocities::zeros(), periods.min(delay));
        MotionEstimate { now, weight: 1.0, innovation, disturbance, wrench, next: None, past, terms: 0 }
    }

    /// Updates the weights by the innovations.
    fn weigh(&self, models: &mut [MotionEstimate], logs: &mut [f64]) {
        let [linear, angular, joints] = self.bank.precision;
        for (log, innovation) in logs.iter_mut().zip(models.iter().filter_map(|estimate| estimate.innovation)) {
            let square = |from: usize, count: usize| innovation.rows(from, count).norm_squared();
            let sum = linear * square(0, 3) + angular * square(3, 3) + joints * square(6, self.size - 6);
            self.bank.update(log, -sum);
        }
        normalise(logs);
        for (estimate, log) in models.iter_mut().zip(logs.iter()) {
            estimate.weight = if *log < NEGLIGIBLE { 0.0 } else { exp(*log) };
        }
    }

    /// Predicts from a measurement to the present; without weight, only to the next measurement. The model that leads
    /// evaluates the terms; past its present, the last ones serve the others.
    fn predict(
        &self,
        model: &NominalModel,
        k: usize,
        efforts: &[Velocities],
        estimate: &mut MotionEstimate,
        terms: &mut Vec<Equations>,
        leads: bool,
    ) {
        let steps = if leads || estimate.weight > 0.0 { estimate.past } else { estimate.past.min(1) };
        for step in 0..steps {
            let before = estimate.past - 1 - step;
            let effort = self.scale(k, &efforts[before]);
            let MotionEstimate { now, wrench, disturbance, .. } = &mut *estimate;
            let terms_now = &terms[step.min(terms.len() - 1)];
            self.predictor.advance(terms_now, (now, wrench), [&effort, disturbance], before as f64 + 0.5);
            if step == 0 {
                estimate.next = Some((estimate.now.velocities, estimate.wrench));
            }
            if leads {
                terms.push(self.predictor.equations(model, &estimate.now));
            }
        }
        estimate.terms = steps.min(terms.len() - 1);
    }

    /// Mean effort of a law on the models' estimates, by their weights: each minus its disturbance, with its lag
    /// compensated, and over its factor on the thrust. The law's arguments are a model's index, present and terms.
    pub fn mean(
        &self,
        estimates: &MotionEstimates,
        law: impl Fn(usize, &TrackingState, &Equations) -> Velocities,
    ) -> Velocities {
        let (mut total, mut sum) = (0.0, Velocities::zeros());
        for (k, estimate) in estimates.models.iter().enumerate().filter(|(_, estimate)| estimate.weight > 0.0) {
            let mut effort = law(k, &estimate.now, &estimates.terms[estimate.terms]) - estimate.disturbance;
            self.predictor.compensate_lag(&estimate.wrench, &mut effort);
            effort.fixed_rows_mut::<6>(0).unscale_mut(self.bank.models[k].thrust);
            sum += effort * estimate.weight;
            total += estimate.weight;
        }
        sum / total
    }

    /// Stores the commanded effort, and the predictions of the next measurement.
    pub fn remember(&self, estimates: MotionEstimates, effort: &Velocities, memory: &mut [f64]) {
        let (size, delay, [_, periods, states, efforts]) = (self.size, self.bank.delay(), self.split(memory));
        let MotionEstimates { models, terms, .. } = estimates;
        for (k, (estimate, state)) in models.into_iter().zip(states.chunks_exact_mut(self.width())).enumerate() {
            let MotionEstimate { mut now, mut wrench, disturbance, next, terms: at, .. } = estimate;
            let (predicted, wrench) = next.unwrap_or_else(|| {
                let effort = self.scale(k, effort);
                self.predictor.advance(&terms[at], (&mut now, &mut wrench), [&effort, &disturbance], 0.0);
                (now.velocities, wrench)
            });
            state[..size].copy_from_slice(&predicted.as_slice()[..size]);
            // The next measurement is of a later time than this one.
            if periods[0] as usize >= self.bank.models[k].delay {
                state[2 * size..].copy_from_slice(wrench.as_slice());
            }
        }
        periods[0] = (periods[0] + 1.0).min((delay + 1) as f64);
        if delay > 0 {
            efforts.copy_within(..(delay - 1) * size, size);
            efforts[..size].copy_from_slice(&effort.as_slice()[..size]);
        }
    }

    /// Effort with a model's factor on the wrench.
    fn scale(&self, k: usize, effort: &Velocities) -> Velocities {
        let mut scaled = *effort;
        scaled.fixed_rows_mut::<6>(0).scale_mut(self.bank.models[k].thrust);
        scaled
    }
}

/// Index of the maximum of these; the first of none.
fn likeliest(logs: &[f64]) -> usize {
    (0..logs.len()).fold(0, |best, k| if logs[k] > logs[best] { k } else { best })
}

/// Velocities or forces, padded with 0.
fn padded(given: &[f64]) -> Velocities {
    let mut all = Velocities::zeros();
    all.iter_mut().zip(given).for_each(|(entry, x)| *entry = *x);
    all
}

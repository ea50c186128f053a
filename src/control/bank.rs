//! Bank of models of delay and thrust, weighed by the likelihood of their innovations. `[Mag65]`

use crate::lane::Lane;

/// Minimum logarithm of a weight over the maximum: where [`exp`](crate::lane::exp) ends.
const FLOOR: f64 = -20.0;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BankModel {
    /// Age of measurements, control periods.
    pub delay: usize,
    /// Motion per command over the nominal model's.
    pub thrust: f64,
}

/// Models in ascending order of delay, and the log-likelihood of their normal innovations, which fades. A bank of
/// models that are alike has no weights.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Bank<const K: usize> {
    pub models: Vec<BankModel>,
    /// Half the inverse variances of innovations.
    pub precision: [f64; K],
    /// Share of a log-likelihood that remains after a control period.
    retention: f64,
    weighs: bool,
}

impl<const K: usize> Bank<K> {
    /// Models of a delay that are alike and have no weights.
    pub fn alike(delay: usize, count: usize) -> Self {
        Self {
            models: vec![BankModel { delay, thrust: 1.0 }; count],
            precision: [0.0; K],
            retention: 1.0,
            weighs: false,
        }
    }

    /// Models of each delay up to a maximum and each factor on the thrust, for standard deviations of innovations and a time
    /// constant of forgetting, s; 0: none.
    pub fn new(max_delay: usize, factors: [f64; 3], deviations: [f64; K], [memory_time, period]: [f64; 2]) -> Self {
        let models = (0..=max_delay).flat_map(|delay| factors.map(|thrust| BankModel { delay, thrust })).collect();
        let retention = if memory_time > 0.0 { (-period / memory_time).exp() } else { 1.0 };
        Self { models, precision: deviations.map(|s| 0.5 / (s * s)), retention, weighs: true }
    }

    /// Number of weights.
    pub fn weights(&self) -> usize {
        if self.weighs { self.models.len() } else { 0 }
    }

    /// Maximum delay, control periods.
    #[inline(always)]
    pub fn delay(&self) -> usize {
        self.models[self.models.len() - 1].delay
    }

    /// Adds the log-likelihood of an innovation.
    #[inline(always)]
    pub fn update<L: Lane<Real = f64>>(&self, log: &mut L, gain: L) {
        *log = log.mul_add(L::c(self.retention), gain);
    }
}

/// Logarithms of weights over the maximum.
#[inline(always)]
pub(super) fn normalise<L: Lane<Real = f64>>(logs: &mut [L]) {
    let mut maximum = logs[0];
    for k in 1..logs.len() {
        maximum = maximum.max(logs[k]);
    }
    for k in 0..logs.len() {
        logs[k] = (logs[k] - maximum).max(L::c(FLOOR));
    }
}

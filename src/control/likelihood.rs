//! Weights of a bank's models, by the likelihood of their innovations. `[Mag65]`

use crate::lane::Lane;

/// Minimum logarithm of a weight over the maximum: where [`exp`](crate::lane::exp) ends.
const FLOOR: f64 = -20.0;

/// Log-likelihood of normal innovations that fades.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Likelihood<const K: usize> {
    /// Half the inverse variances of innovations.
    pub precision: [f64; K],
    /// Share of a log-likelihood that remains after a control period.
    retention: f64,
}

impl<const K: usize> Likelihood<K> {
    /// For a single model, which has no weight.
    pub fn none() -> Self {
        Self { precision: [0.0; K], retention: 1.0 }
    }

    /// For standard deviations of innovations and a time constant of forgetting, s; 0: none.
    pub fn new(deviations: [f64; K], memory_time: f64, period: f64) -> Self {
        let retention = if memory_time > 0.0 { (-period / memory_time).exp() } else { 1.0 };
        Self { precision: deviations.map(|s| 0.5 / (s * s)), retention }
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

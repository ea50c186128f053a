//! Options of a simulator.

use crate::description::{Integration, Scene};
use crate::integrate::Gains;

/// Number type of the kernels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// f64, the default: every accuracy claim refers to it.
    Double,
    /// f32: twice as fast.
    Single,
}

impl Precision {
    /// Minimum magnitude that rounds to infinity.
    fn bound(self) -> f64 {
        match self {
            Precision::Double => f64::INFINITY,
            // Half a unit in the last place above the maximum number.
            Precision::Single => f64::from(f32::MAX) + 2.0_f64.powi(103),
        }
    }

    /// True where `x` is a finite number of this type.
    pub fn is_finite(self, x: f64) -> bool {
        x.abs() < self.bound()
    }

    /// True where all values are finite numbers of this type. (The loop has no early exit, so that it vectorises.)
    pub fn all_finite(self, values: &[f64]) -> bool {
        let bound = self.bound();
        values.iter().fold(true, |all, x| all & (x.abs() < bound))
    }

    /// Distance of 1 to the next number.
    pub fn epsilon(self) -> f64 {
        match self {
            Precision::Double => f64::EPSILON,
            Precision::Single => f64::from(f32::EPSILON),
        }
    }
}

/// Options of a [`super::Simulator`].
#[derive(Debug, Clone, PartialEq)]
pub struct SimulatorOptions {
    /// Number of instances.
    pub instances: usize,
    /// Step size, s.
    pub dt: f64,
    /// Integrator, by the names of [`crate::integrate::Integrator::NAMES`].
    pub integrator: String,
    /// Gain of eq. 14, for the quaternion integrators, 1/s.
    pub gamma: f64,
    /// Bound on the estimated error of a sub-interval of a step, for adaptive integrators: absolute in m and rad for the
    /// pose, absolute and relative for twist, q and q'. Minimum value 8 times the precision's epsilon (1e-6 in single
    /// precision); smaller ones count as that.
    pub tolerance: f64,
    /// Number type.
    pub precision: Precision,
    /// Maximum number of threads; number of cores where `None`. Few instances use fewer.
    pub threads: Option<usize>,
    /// True to estimate accumulated errors of all instances, false to estimate none; `None` to watch few instances, or a few out
    /// of many in turns, for warnings.
    pub error_estimate: Option<bool>,
}

impl SimulatorOptions {
    /// Defaults for a scene: with the integrator and step that it states.
    pub fn of(scene: &Scene) -> Self {
        let Integration { integrator, step } = scene.integration();
        Self { dt: step, integrator, ..Self::default() }
    }
}

impl Default for SimulatorOptions {
    fn default() -> Self {
        let Integration { integrator, step } = Integration::default();
        Self {
            instances: 1,
            dt: step,
            integrator,
            gamma: Gains::DEFAULT.gamma,
            tolerance: Gains::DEFAULT.tolerance,
            precision: Precision::Double,
            threads: None,
            error_estimate: None,
        }
    }
}

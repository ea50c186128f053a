//! Step monitor: finds instances that the steps do not integrate accurately, and warns of the first one.

use std::fmt;

use super::step_quality::{ERROR_LIMIT, QualityLimits, StepQuality, StepViolation};
use super::text::{StiffIntegrators, digits};
use crate::batch::storage::columns::Columns;
use crate::batch::storage::layout::Layout;
use crate::batch::storage::table::Table;
use crate::dynamics::Servos;
use crate::integrate::{StepEstimates, step_error, stiffness};
use crate::lane::{Isa, Kernel, Lane, Real};

impl Table {
    /// The first of `count` instances that is not finite or beyond the limits.
    pub fn first_violation<T: Real>(
        &self,
        isa: Isa,
        rows: &mut [T],
        count: usize,
        limits: QualityLimits,
        h: f64,
    ) -> Option<StepViolation> {
        let width = self.layout.rows * T::BLOCK;
        let mut first = 0;
        loop {
            // Blocks in lanes; then the instances of the block in question one by one.
            let blocks = &mut rows[first * self.layout.rows..];
            let count = count.saturating_sub(first);
            let mut search = FindViolation { layout: &self.layout, limits, h, count, blocks, block: None };
            T::dispatch(isa, &mut search);
            first += search.block? * T::BLOCK;
            let block = &rows[first * self.layout.rows..][..width];
            let found = (first..count.min(first + T::BLOCK)).find_map(|i| self.violation(block, i - first, limits, h));
            if let Some(violation) = found {
                return Some(StepViolation { instance: first + violation.instance, ..violation });
            }
            first += T::BLOCK;
        }
    }

    /// Violation of the limits by instance `i`.
    fn violation<T: Real>(&self, rows: &[T], i: usize, limits: QualityLimits, h: f64) -> Option<StepViolation> {
        let quality = self.step_quality(rows, i, h);
        let within = quality.stiffness <= limits.stiffness && quality.error <= limits.error;
        // The rows before the time are the state.
        let finite = (0..self.layout.time).all(|row| self.get(rows, i, row).is_finite());
        (!finite || !within).then(|| StepViolation { instance: i, time: self.state(rows, i).time, quality, finite })
    }
}

/// Finds the first block with an instance that may not be finite or may be beyond the limits.
struct FindViolation<'a, T> {
    layout: &'a Layout,
    limits: QualityLimits,
    h: f64,
    /// Instances: columns past them are left out.
    count: usize,
    blocks: &'a mut [T],
    /// The block found.
    block: Option<usize>,
}

impl<T: Real> Kernel<T> for FindViolation<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        let blocks = std::mem::take(&mut self.blocks).chunks_exact_mut(self.layout.rows * T::BLOCK);
        for (k, rows) in blocks.enumerate() {
            for first in (0..T::BLOCK).step_by(L::LANES) {
                if k * T::BLOCK + first >= self.count {
                    break;
                }
                let columns = Columns { rows: &mut *rows, first };
                // Zero times each number of the state (the rows before the time): NaN for one that is not finite. In four
                // sums, which need not wait for each other.
                let mut sums = [L::zero(); 4];
                for row in 0..self.layout.time {
                    sums[row % 4] = columns.get::<L>(row).mul_add(L::zero(), sums[row % 4]);
                }
                let sum = (sums[0] + sums[1]) + (sums[2] + sums[3]);
                let StepEstimates::<L> { contrast, velocity_error, spin_error, .. } =
                    columns.step_estimates(self.layout);
                let stiffness = stiffness(contrast, T::EPSILON);
                let error = step_error([velocity_error[0], velocity_error[1], spin_error], self.h);
                let within = L::and(stiffness.lt(L::c(self.limits.stiffness)), error.lt(L::c(self.limits.error)));
                let good = L::and(sum.lt(L::c(1.0)), within);
                if L::bits(good).count_ones() as usize != L::LANES {
                    self.block = Some(k);
                    return;
                }
            }
        }
    }
}

/// State of the monitor: each warning is given once.
#[derive(Debug, Clone, Copy, Default)]
pub struct StepMonitor {
    /// Modal analyses done, by the servos that were on.
    analysed: [bool; 4],
    unstable_step_warned: bool,
    violation: Option<StepViolation>,
    violation_warned: bool,
}

impl StepMonitor {
    /// True once for each choice of servos, until a warning of an unstable step: the step is then to be checked.
    pub fn needs_modal_analysis(&mut self, servos: Servos) -> bool {
        !self.unstable_step_warned && !std::mem::replace(&mut self.analysed[servos.index()], true)
    }

    /// Records a warning of an unstable step.
    pub fn set_unstable_step_warned(&mut self) {
        self.unstable_step_warned = true;
    }

    /// Limits of the steps' quality for a method with this range of `h |lambda|`; none after the first violation.
    pub fn limits(&self, range: f64) -> Option<QualityLimits> {
        // After a warning of an unstable step only states that are not finite are news.
        let limits = if self.unstable_step_warned {
            QualityLimits { stiffness: f64::INFINITY, error: f64::INFINITY }
        } else {
            QualityLimits { stiffness: range, error: ERROR_LIMIT }
        };
        self.violation.is_none().then_some(limits)
    }

    /// Records a violation; the first one counts.
    pub fn record(&mut self, violation: Option<StepViolation>) {
        self.violation = self.violation.or(violation);
    }

    /// The violation to warn of, once.
    pub fn take_violation(&mut self) -> Option<StepViolation> {
        let violation = self.violation.filter(|_| !self.violation_warned)?;
        self.violation_warned = true;
        Some(violation)
    }
}

/// Warning of a step that is too long for the motion of an instance; displays as one line.
#[derive(Debug, Clone, PartialEq)]
pub struct InaccurateStep {
    /// Name of the scene.
    pub scene: String,
    /// Name of the integrator.
    pub integrator: String,
    /// Step, s.
    pub dt: f64,
    /// Greatest `h |lambda|` at which the integrator is accurate.
    pub range: f64,
    /// The first violation.
    pub violation: StepViolation,
}

impl fmt::Display for InaccurateStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, integrator, dt, range, violation } = self;
        let StepViolation { instance, time, quality: StepQuality { stiffness, error }, finite } = *violation;
        let symptom = if finite { "integration inaccurate" } else { "state not finite" };
        write!(f, "scene '{scene}', instance {instance}: {symptom} at t = {time:.6} s ")?;
        write!(f, "with integrator '{integrator}' at dt = {dt} s")?;
        let excited = stiffness.is_finite() && stiffness > 0.0;
        let mut figures = Vec::new();
        if excited {
            figures.push(format!("rate {} 1/s, h*lambda = {}", digits(stiffness / dt), digits(stiffness)));
        }
        if range.is_finite() {
            let of = if excited { "" } else { " of h*lambda" };
            figures.push(format!("limit{of} {}", digits(*range)));
        }
        if error.is_finite() && error > ERROR_LIMIT {
            figures.push(format!("velocity error {:.1} %, limit {:.0} %", 100.0 * error, 100.0 * ERROR_LIMIT));
        }
        if !figures.is_empty() {
            write!(f, " ({})", figures.join(", "))?;
        }
        if finite && excited && stiffness > *range {
            write!(f, "; a step of at most {} s", digits(dt * range / stiffness))?;
        } else {
            write!(f, "; a smaller step")?;
        }
        write!(f, "{StiffIntegrators} would do")
    }
}

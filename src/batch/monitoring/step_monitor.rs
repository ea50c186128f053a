//! Step monitor: finds instances that the steps do not integrate accurately, and warns once of each cause.

use std::fmt;

use super::error_estimate::ErrorEstimate;
use super::step_quality::{
    ACCUMULATED_LIMIT, Cause, ERROR_LIMIT, FOLLOWED_ERROR_LIMIT, KNOWN_LIMIT, QualityLimits, StepQuality,
    StepViolation, Violations,
};
use crate::batch::options::{Precision, SimulatorOptions};
use crate::batch::storage::layout::Layout;
use crate::batch::storage::table::Table;
use crate::dynamics::Servos;
use crate::integrate::{StepEstimates, step_error, stiffness};
use crate::lane::{Isa, Kernel, Lane, Real, Rows};

impl Table {
    /// Violations of the limits by the last steps of `count` instances.
    pub fn violations<T: Real>(
        &self,
        isa: Isa,
        rows: &mut [T],
        count: usize,
        limits: QualityLimits,
        h: f64,
    ) -> Violations {
        let mut violations = Violations::default();
        let mut search = FindViolation { layout: &self.layout, limits, h, count, blocks: &mut *rows, block: None };
        T::dispatch(isa, &mut search);
        // Blocks in lanes; from the block in question on the instances one by one.
        for instance in search.block.map_or(count, |block| block * T::BLOCK)..count {
            if let Some(cause) = self.violation(rows, instance, limits, h) {
                let (time, quality) = (self.state(rows, instance).time, self.step_quality(rows, instance, h));
                violations.add(cause, StepViolation { instance, count: 1, time, quality });
            }
        }
        violations
    }

    /// Limit that the last steps of instance `i` violate.
    pub fn violation<T: Real>(&self, rows: &[T], i: usize, limits: QualityLimits, h: f64) -> Option<Cause> {
        let StepQuality { stiffness, error, .. } = self.step_quality(rows, i, h);
        // The rows before the time are the state.
        if !(0..self.layout.time).all(|row| self.get(rows, i, row).is_finite()) {
            return limits.finite.then_some(Cause::NotFinite);
        }
        let beyond = |x: f64, limit: f64| limit.is_finite() && (x > limit || x.is_nan());
        (beyond(stiffness, limits.stiffness) || beyond(error, limits.error)).then_some(Cause::Inaccurate)
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
                let columns = Rows::of_block(&mut *rows, first);
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
    violations: [Option<StepViolation>; Cause::ALL.len()],
    warned: [bool; Cause::ALL.len()],
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

    /// Limits for a method with this range of `h |lambda|`; none once every warning has been given. Accumulated errors, where
    /// they are `estimated`, are more reliable than the velocity errors of the last steps.
    pub fn limits(&self, range: f64, estimated: bool) -> Option<QualityLimits> {
        let watched = |cause: Cause| self.violations[cause as usize].is_none();
        let limit = |watched: bool, limit: f64| if watched { limit } else { f64::INFINITY };
        // After a warning of an unstable step only states that are not finite are reported; after those nothing is.
        let finite = watched(Cause::NotFinite);
        let steps = finite && watched(Cause::Inaccurate) && !self.unstable_step_warned;
        let limits = QualityLimits {
            stiffness: limit(steps, range),
            error: limit(steps, if estimated { FOLLOWED_ERROR_LIMIT } else { ERROR_LIMIT }),
            accumulated: limit(steps && watched(Cause::Accumulated), ACCUMULATED_LIMIT),
            finite,
        };
        finite.then_some(limits)
    }

    /// Records violations; the first of each cause count.
    pub fn record(&mut self, violations: &Violations) {
        for cause in Cause::ALL {
            let known = &mut self.violations[cause as usize];
            *known = known.or(violations.of(cause));
        }
    }

    /// A violation to warn of, each cause once.
    pub fn take_violation(&mut self) -> Option<(Cause, StepViolation)> {
        let news = |cause: &Cause| !self.warned[*cause as usize] && self.violations[*cause as usize].is_some();
        let cause = Cause::ALL.into_iter().find(news)?;
        self.warned[cause as usize] = true;
        Some((cause, self.violations[cause as usize]?))
    }
}

/// Warning of steps that are too long for the motion of instances; displays as one line.
#[derive(Debug, Clone, PartialEq)]
pub struct InaccurateStep {
    /// Name of the scene.
    pub scene: String,
    /// Options of the simulator.
    pub options: SimulatorOptions,
    /// Order of the integrator.
    pub order: usize,
    /// True where it chooses sub-intervals by its tolerance.
    pub adaptive: bool,
    /// Maximum `h |lambda|` at which the integrator is accurate.
    pub range: f64,
    /// Cause of the warning.
    pub cause: Cause,
    /// The instances.
    pub violation: StepViolation,
    /// Estimated errors of the first one.
    pub estimate: Option<ErrorEstimate>,
}

impl fmt::Display for InaccurateStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, options, order, adaptive, range, cause, violation, estimate } = self;
        let SimulatorOptions { integrator, dt, instances, precision, .. } = options;
        let StepViolation { instance, count, time, quality: StepQuality { stiffness, error, accumulated } } =
            *violation;
        write!(f, "scene '{scene}', instance {instance}")?;
        if count > 1 {
            write!(f, " and {} more of {instances}", count - 1)?;
        }
        let symptom = match cause {
            Cause::NotFinite => "state not finite",
            Cause::Inaccurate => "integration inaccurate",
            Cause::Accumulated => "errors have added up",
        };
        write!(f, ": {symptom} at t = {time:.6} s with integrator '{integrator}' at dt = {dt} s")?;
        if *cause == Cause::Accumulated && !accumulated.is_finite() {
            write!(f, " (no estimate: the same motion at half the step does not stay finite)")?;
            write!(f, "; a smaller step{} may do", OtherIntegrators { failed: integrator, stiff: false })
        } else if *cause == Cause::Accumulated {
            write!(f, " (")?;
            if let Some(estimate) = estimate {
                write!(f, "estimate: {estimate}; ")?;
            }
            let (percent, limit) = (100.0 * accumulated, 100.0 * ACCUMULATED_LIMIT);
            write!(f, "{percent:.1} % of the motion, limit {limit:.0} %")?;
            // Rounding in single precision is part of the error.
            if *precision == Precision::Single && accumulated < KNOWN_LIMIT {
                write!(f, "); double precision or a smaller step may do")
            } else if *adaptive {
                write!(f, "); a smaller tolerance would do")
            } else if accumulated < KNOWN_LIMIT {
                // To a quarter of the limit.
                let step = dt * (0.25 * ACCUMULATED_LIMIT / accumulated).powf(1.0 / *order as f64);
                write!(f, "); a step of at most {} s would do", digits(step))
            } else {
                write!(f, ", beyond what the estimate can tell: the motion is chaotic, or the step far too long)")?;
                write!(f, "; a smaller step{} may do", OtherIntegrators { failed: integrator, stiff: false })
            }
        } else {
            let excited = stiffness.is_finite() && stiffness > 0.0;
            let too_fast = excited && stiffness > *range;
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
            if *cause == Cause::Inaccurate && too_fast {
                write!(f, "; a step of at most {} s", digits(dt * range / stiffness))?;
            } else {
                write!(f, "; a smaller step")?;
            }
            let stiff = match cause {
                // Explicit methods diverge of fast modes; linearly implicit ones have no range.
                Cause::NotFinite => range.is_finite() || *adaptive,
                _ => too_fast && error <= ERROR_LIMIT,
            };
            write!(f, "{} would do", OtherIntegrators { failed: integrator, stiff })
        }
    }
}

/// Advice of other integrators for a step that is too long: " or integrator 'ros2' or 'mk54'"; empty if neither would do.
pub struct OtherIntegrators<'a> {
    /// Integrator for which the step is too long.
    pub failed: &'a str,
    /// True where the cause is a fast mode. `ros2` lets it decay, but is less accurate in all else.
    pub stiff: bool,
}

impl fmt::Display for OtherIntegrators<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let known = [("ros2", self.stiff), ("mk54", true)];
        let others = known.into_iter().filter(|&(name, helps)| helps && name != self.failed);
        for (k, (name, _)) in others.enumerate() {
            write!(f, "{}'{name}'", if k == 0 { " or integrator " } else { " or " })?;
        }
        Ok(())
    }
}

/// A number with three significant digits.
pub fn digits(x: f64) -> String {
    if x == 0.0 {
        return "0".into();
    }
    let decimals = (2.0 - x.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{x:.decimals$}")
}

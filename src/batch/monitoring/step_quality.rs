//! Quality of an instance's steps, its limits, and violations of these.

/// Maximum relative velocity error of the last steps that passes without a warning.
pub const ERROR_LIMIT: f64 = 0.05;
/// [`ERROR_LIMIT`] where companions follow all instances. Their estimate of the error is better, but misses a fast motion that
/// instance and companion both damp out.
pub const FOLLOWED_ERROR_LIMIT: f64 = 0.2;
/// Maximum estimate of the accumulated error, relative to the scales of the motion, that passes without a warning.
pub const ACCUMULATED_LIMIT: f64 = 0.02;
/// Maximum estimate of the accumulated error at which the leading order of a method dominates.
pub const KNOWN_LIMIT: f64 = 0.1;

/// Maximum; NaN where either number is.
pub fn maximum(a: f64, b: f64) -> f64 {
    if a >= b || a.is_nan() { a } else { b }
}

/// Quality of an instance's steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepQuality {
    /// `h |lambda|` of the fastest rate that the motion excites, over the last steps.
    pub stiffness: f64,
    /// Relative velocity error of the last steps.
    pub error: f64,
    /// Accumulated error relative to the scales of the motion; 0 where it is not estimated.
    pub accumulated: f64,
}

/// Limits of [`StepQuality`], and of states.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QualityLimits {
    /// Maximum [`StepQuality::stiffness`].
    pub stiffness: f64,
    /// Maximum [`StepQuality::error`].
    pub error: f64,
    /// Maximum [`StepQuality::accumulated`].
    pub accumulated: f64,
    /// True where states that are not finite are violations.
    pub finite: bool,
}

/// Cause of a warning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// A state is not finite.
    NotFinite,
    /// The last steps are too long for the motion.
    Inaccurate,
    /// Errors have added up.
    Accumulated,
}

/// Instances whose states or steps are beyond their limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepViolation {
    /// Number of the first instance.
    pub instance: usize,
    /// Number of instances.
    pub count: usize,
    /// Time of the first one, s.
    pub time: f64,
    /// Quality of its steps.
    pub quality: StepQuality,
}

/// Violations by their causes. (Boxed: a call without any moves nothing.)
#[derive(Debug, Clone, Default)]
pub struct Violations(Option<Box<[Option<StepViolation>; Cause::ALL.len()]>>);

impl Cause {
    /// All causes.
    pub const ALL: [Self; 3] = [Self::NotFinite, Self::Inaccurate, Self::Accumulated];
}

impl Violations {
    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_none()
    }

    /// Violations of one cause.
    pub fn of(&self, cause: Cause) -> Option<StepViolation> {
        self.0.as_ref()?[cause as usize]
    }

    /// Adds violations of one cause.
    pub fn add(&mut self, cause: Cause, violation: StepViolation) {
        let known = self.of(cause);
        let count = known.map_or(0, |known| known.count) + violation.count;
        let first = known.filter(|known| known.instance < violation.instance).unwrap_or(violation);
        self.0.get_or_insert_default()[cause as usize] = Some(StepViolation { count, ..first });
    }

    /// Adds all of others, whose instances count from `first`.
    pub fn merge(&mut self, others: &Self, first: usize) {
        for cause in Cause::ALL {
            if let Some(violation) = others.of(cause) {
                self.add(cause, StepViolation { instance: first + violation.instance, ..violation });
            }
        }
    }
}

//! Quality of an instance's last steps, its limits, and violations of these.

/// Greatest relative velocity error of the last steps that passes without a warning.
pub const ERROR_LIMIT: f64 = 0.05;

/// Quality of an instance's last steps, estimated from their stages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepQuality {
    /// `h |lambda|` of the fastest rate that the motion excites.
    pub stiffness: f64,
    /// Relative velocity error of the last steps.
    pub error: f64,
}

/// Limits of [`StepQuality`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QualityLimits {
    /// Greatest [`StepQuality::stiffness`].
    pub stiffness: f64,
    /// Greatest [`StepQuality::error`].
    pub error: f64,
}

/// An instance whose state is not finite or whose step quality is beyond its limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepViolation {
    /// Number of the instance.
    pub instance: usize,
    /// Its time, s.
    pub time: f64,
    /// Quality of its last steps.
    pub quality: StepQuality,
    /// False where its state is not finite.
    pub finite: bool,
}

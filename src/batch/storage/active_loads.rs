//! Optional loads that are active.

/// Optional loads that are active, the same for all instances.
#[derive(Debug, Clone, Copy, Default)]
pub struct ActiveLoads {
    /// Coefficients of each joint servo's target; 0 where these servos are off.
    pub target_terms: usize,
    /// External wrenches on links.
    pub link_wrenches: bool,
    /// The vehicle's servo, which keeps a station within the stages.
    pub station: bool,
}

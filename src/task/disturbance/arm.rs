//! Motion of the arm's reference.

use serde::{Deserialize, Serialize};

use super::component::Component;
use super::context::DisturbanceContext;
use super::span::check;
use crate::error::TaskError;

/// Factors on the arm's reference, which stays within the joints' limits and speeds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ArmMotion {
    /// Factor on its amplitude.
    pub amplitude: f64,
    /// Factor on its speed.
    pub speed: f64,
}

impl Default for ArmMotion {
    fn default() -> Self {
        Self { amplitude: 1.0, speed: 1.0 }
    }
}

impl Component for ArmMotion {
    const RESERVED: bool = false;

    fn check(&self, _context: &DisturbanceContext) -> Result<(), TaskError> {
        check("arm.amplitude", self.amplitude, 0.0, 10.0)?;
        check("arm.speed", self.speed, 0.0, 10.0)
    }
}

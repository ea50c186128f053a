//! How much the arm's reference moves.

use serde::{Deserialize, Serialize};

use super::span::check;
use crate::error::TaskError;

/// Factors on the arm's reference. Whatever they are, it keeps to the joints' limits and speeds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ArmMotion {
    /// On its amplitude.
    pub amplitude: f64,
    /// On its speed.
    pub speed: f64,
}

impl Default for ArmMotion {
    fn default() -> Self {
        Self { amplitude: 1.0, speed: 1.0 }
    }
}

impl ArmMotion {
    pub(super) fn check(&self) -> Result<(), TaskError> {
        check("arm.amplitude", self.amplitude, 0.0, 10.0)?;
        check("arm.speed", self.speed, 0.0, 10.0)
    }
}

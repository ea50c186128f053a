//! Integrator and step that the motion of a scene needs.

use serde::{Deserialize, Serialize};

use super::Scene;
use crate::keys::{Fault, range};

/// Integrator and step, by default those of simulators and environments.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Integration {
    /// Name of an integrator.
    pub integrator: String,
    /// Step, s.
    pub step: f64,
}

impl Default for Integration {
    fn default() -> Self {
        Self { integrator: "mk4".into(), step: 0.01 }
    }
}

impl Integration {
    /// Refuses a step out of its range. The simulator knows the names of the integrators.
    pub(super) fn check(&self) -> Result<(), Fault> {
        let step = self.step;
        range(step > 0.0 && step <= 1.0, step, "in (0, 1] s", || "integration.step".to_owned())
    }
}

impl Scene {
    /// Integrator and step of the scene, as stated or the default.
    pub fn integration(&self) -> Integration {
        self.integration.clone().unwrap_or_default()
    }
}

//! Tether of a vehicle.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::numbers;

/// A quasi-static tether: the vehicle carries weight in water and drag of one half, which moves with the point of attachment;
/// the other end carries the other half. `[HC eq. 21]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tether {
    /// Point of attachment in the vehicle frame, m.
    #[serde(with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Submerged length, m.
    pub length: f64,
    /// Diameter d, m.
    pub diameter: f64,
    /// Mass per length, kg/m.
    #[serde(default)]
    pub mass_per_length: f64,
    /// Drag coefficient C_D in cross flow.
    #[serde(default = "cylinder")]
    pub drag: f64,
}

/// Drag coefficient of a circular cylinder.
fn cylinder() -> f64 {
    1.2
}

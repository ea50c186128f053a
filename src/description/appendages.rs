//! What else the water has to do with on a vehicle: fins and a tether.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::numbers;

/// A fin or another lifting surface: law and symbols in [`crate::hydro::Fin`]. `[HC eq. 21]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fin {
    /// Name, for people.
    pub name: String,
    /// Centre of pressure in the vehicle frame, m.
    #[serde(with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Direction of the leading edge at deflection 0, across `axis`; normalised on reading.
    #[serde(with = "numbers::vector3")]
    pub chord: Vector3<f64>,
    /// Direction of the span, about which deflection turns the fin; normalised on reading. Lift at a positive angle of attack points
    /// along `chord x axis`.
    #[serde(with = "numbers::vector3")]
    pub axis: Vector3<f64>,
    /// Planform area A, m2.
    pub area: f64,
    /// Lift slope a at small angles, 1/rad.
    pub lift_slope: f64,
    /// Drag coefficient C_D0 without lift.
    #[serde(default)]
    pub drag: f64,
    /// k of the drag `k C_L^2` that comes with lift.
    #[serde(default)]
    pub induced_drag: f64,
    /// Angle of attack at which half of the fin has stalled, rad. Without one it never stalls.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stall: Option<f64>,
    /// Coefficient C_90 of the normal force of the stalled fin, a plate, across the flow.
    #[serde(default = "plate")]
    pub plate: f64,
    /// Deflection without command, rad.
    #[serde(default)]
    pub deflection: f64,
    /// Least and greatest deflection, rad. Without them the fin does not move.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "numbers::optional_array")]
    pub limits: Option<[f64; 2]>,
}

/// Of a plate of small aspect ratio.
fn plate() -> f64 {
    1.2
}

impl Fin {
    /// Least and greatest deflection, rad.
    pub fn range(&self) -> [f64; 2] {
        self.limits.unwrap_or([self.deflection; 2])
    }

    /// Direction of lift at small positive angles of attack and deflection 0.
    pub fn normal(&self) -> Vector3<f64> {
        self.chord.cross(&self.axis)
    }
}

/// A cable, quasi-statically: weight in water and drag of half of it pull at the vehicle (its other end bears the other half),
/// as if all of that half moved with the point of attachment. `[HC eq. 21]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tether {
    /// Point of attachment in the vehicle frame, m.
    #[serde(with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Length in the water, m.
    pub length: f64,
    /// Diameter d, m.
    pub diameter: f64,
    /// Mass per length, kg/m.
    #[serde(default)]
    pub mass_per_length: f64,
    /// Drag coefficient C_D of the flow across it.
    #[serde(default = "cylinder")]
    pub drag: f64,
}

/// Of a circular cylinder.
fn cylinder() -> f64 {
    1.2
}

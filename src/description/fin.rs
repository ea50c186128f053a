//! Fins and other lifting surfaces of a vehicle.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::numbers;

/// A fin or another lifting surface: law and symbols in [`crate::hydro::Fin`]. `[HC eq. 21]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fin {
    /// Name, by which keys select the fin: `vehicle.fins[NAME]`.
    pub name: String,
    /// Centre of pressure in the vehicle frame, m.
    #[serde(with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Direction of the leading edge at deflection 0, perpendicular to `axis`; normalised on reading.
    #[serde(with = "numbers::vector3")]
    pub chord: Vector3<f64>,
    /// Direction of the span and axis of deflection; normalised on reading. Lift at a positive angle of attack points along
    /// `chord x axis`.
    #[serde(with = "numbers::vector3")]
    pub axis: Vector3<f64>,
    /// Planform area A, m2.
    pub area: f64,
    /// Lift slope a at small angles, 1/rad.
    pub lift_slope: f64,
    /// Parasitic drag coefficient C_D0.
    #[serde(default)]
    pub drag: f64,
    /// Factor k of the induced drag `k C_L^2`.
    #[serde(default)]
    pub induced_drag: f64,
    /// Angle of attack at which half of the fin has stalled, rad. Without it the fin never stalls.
    pub stall: Option<f64>,
    /// Normal force coefficient C_90 of the stalled fin, a flat plate broadside to the flow.
    #[serde(default = "plate")]
    pub plate: f64,
    /// Deflection without command, rad.
    #[serde(default)]
    pub deflection: f64,
    /// Minimum and maximum deflection, rad. Without limits the fin is fixed.
    #[serde(default, deserialize_with = "numbers::optional_array")]
    pub limits: Option<[f64; 2]>,
}

/// Normal force coefficient of a plate of small aspect ratio.
fn plate() -> f64 {
    1.2
}

impl Fin {
    /// Minimum and maximum deflection, rad.
    pub fn range(&self) -> [f64; 2] {
        self.limits.unwrap_or([self.deflection; 2])
    }

    /// Direction of lift at small positive angles of attack and deflection 0.
    pub fn normal(&self) -> Vector3<f64> {
        self.chord.cross(&self.axis)
    }
}

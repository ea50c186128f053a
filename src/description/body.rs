//! A rigid body and its hydrodynamic coefficients.

use nalgebra::{Matrix3, Matrix6, Vector3};
use serde::{Deserialize, Serialize};

use super::Frame;
use crate::keys::numbers;

/// A rigid body and its hydrodynamics, in the body frame.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass, m.
    #[serde(default, with = "numbers::vector3")]
    pub center_of_mass: Vector3<f64>,
    /// Moments of inertia, kg m2: `[xx, yy, zz]`, `[xx, xy, xz, yy, yz, zz]` or three rows of three.
    /// Products are entries of the matrix (`xy` is `-∫ x y dm`).
    #[serde(with = "numbers::inertia")]
    pub inertia: Matrix3<f64>,
    /// Reference point of `inertia`.
    #[serde(default)]
    pub inertia_at: InertiaPoint,
    /// Weight in a vacuum, N: an optional cross-check of `mass`.
    pub weight: Option<f64>,
    /// Displaced volume, m3; 0 without `volume` and `buoyancy`.
    pub volume: Option<f64>,
    /// Buoyancy, N, instead of `volume`: divided by water density times gravity.
    pub buoyancy: Option<f64>,
    /// Centre of buoyancy, m.
    #[serde(default, with = "numbers::vector3")]
    pub center_of_buoyancy: Vector3<f64>,
    /// Frame of `added_mass` and `damping`, relative to the body frame.
    #[serde(default)]
    pub hydrodynamic_frame: Frame,
    /// Added mass A_A, kg, kg m, kg m2: six diagonal numbers or six rows of six; symmetric. `[HC eq. 22]`
    #[serde(default, with = "numbers::matrix6")]
    pub added_mass: Matrix6<f64>,
    /// Linear and quadratic damping in the hydrodynamic frame.
    #[serde(default)]
    pub damping: Damping,
}

impl Body {
    /// A point mass at the origin, without hydrodynamics.
    pub fn point(mass: f64) -> Self {
        Self { mass, ..Self::default() }
    }
}

/// Reference point of an inertia matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum InertiaPoint {
    /// The centre of mass.
    #[default]
    Com,
    /// The origin of the body frame.
    Origin,
}

/// Damping `F = -(D_L V_r + D_Q (V_r * |V_r|))` in the hydrodynamic frame. `[HC eq. 22]`, with the signs of eq. 26.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Damping {
    /// D_L: six diagonal numbers or six rows of six. N s/m, N s/rad, N m s/m, N m s/rad.
    #[serde(default, with = "numbers::matrix6")]
    pub linear: Matrix6<f64>,
    /// D_Q: six diagonal numbers or six rows of six. N s2/m2, N s2/rad2, N m s2/m2, N m s2/rad2.
    #[serde(default, with = "numbers::matrix6")]
    pub quadratic: Matrix6<f64>,
}

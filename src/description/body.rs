//! One rigid body in water: its mass, and what the water does to it.

use nalgebra::{Matrix3, Matrix6, Vector3};
use serde::{Deserialize, Serialize};

use super::numbers;

/// A rigid body and its hydrodynamics, in the body frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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
    /// The point that `inertia` is about.
    #[serde(default)]
    pub inertia_at: InertiaPoint,
    /// Weight in water-free space, N: optional, and then only a cross-check of `mass` against gravity.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weight: Option<f64>,
    /// Displaced volume, m3. Without it and without `buoyancy` the body displaces nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volume: Option<f64>,
    /// Buoyancy, N, instead of `volume`: divided by water density and gravity.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub buoyancy: Option<f64>,
    /// Centre of buoyancy, m.
    #[serde(default, with = "numbers::vector3")]
    pub center_of_buoyancy: Vector3<f64>,
    /// Frame, relative to the body frame, that `added_mass` and `damping` are given in and at.
    #[serde(default)]
    pub hydrodynamic_frame: Frame,
    /// Added mass A_A, kg, kg m, kg m2: six diagonal numbers or six rows of six; symmetric. `[HC eq. 22]`
    #[serde(default = "numbers::zero6", with = "numbers::matrix6")]
    pub added_mass: Matrix6<f64>,
    /// Drag.
    #[serde(default)]
    pub damping: Damping,
}

impl Body {
    /// A point mass at the origin, out of the water's reach.
    pub fn point(mass: f64) -> Self {
        Self {
            mass,
            center_of_mass: Vector3::zeros(),
            inertia: Matrix3::zeros(),
            inertia_at: InertiaPoint::Com,
            weight: None,
            volume: None,
            buoyancy: None,
            center_of_buoyancy: Vector3::zeros(),
            hydrodynamic_frame: Frame::default(),
            added_mass: Matrix6::zeros(),
            damping: Damping::default(),
        }
    }
}

/// The point an inertia matrix is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum InertiaPoint {
    /// The centre of mass.
    #[default]
    Com,
    /// The origin of the body frame.
    Origin,
}

/// Drag `F = -(D_L V_r + D_Q (V_r * |V_r|))` in the hydrodynamic frame. `[HC eq. 22]`, signs as eq. 26 needs them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Damping {
    /// D_L: six diagonal numbers or six rows of six. N s/m, N s/rad, N m s/m, N m s/rad.
    #[serde(default = "numbers::zero6", with = "numbers::matrix6")]
    pub linear: Matrix6<f64>,
    /// D_Q, likewise, per squared speed.
    #[serde(default = "numbers::zero6", with = "numbers::matrix6")]
    pub quadratic: Matrix6<f64>,
}

impl Default for Damping {
    fn default() -> Self {
        Self { linear: Matrix6::zeros(), quadratic: Matrix6::zeros() }
    }
}

/// A constant pose relative to a parent frame.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Origin in the parent frame, m.
    #[serde(default, with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Roll, pitch, yaw about the fixed parent axes, rad (as URDF): `R = Rz(yaw) Ry(pitch) Rx(roll)`.
    #[serde(default, with = "numbers::vector3")]
    pub rpy: Vector3<f64>,
}

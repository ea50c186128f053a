//! Shape of the vehicle in pictures.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{Body, Water};
use crate::keys::numbers;

/// Shape of the vehicle in pictures, without influence on the physics but for a vehicle that docks: spheres of contact at the corners of
/// its outline. Default: the homogeneous box of its mass and inertia.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shape {
    /// Kind of body.
    pub kind: ShapeKind,
    /// Length, width and height, m.
    #[serde(with = "numbers::vector3")]
    pub size: Vector3<f64>,
    /// Centre in the vehicle frame, m.
    #[serde(default, with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Red, green and blue, 0 to 1.
    #[serde(default = "yellow", deserialize_with = "numbers::array")]
    pub colour: [f64; 3],
}

/// Kind of body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ShapeKind {
    /// A closed box.
    Box,
    /// A closed ellipsoid.
    Ellipsoid,
    /// A body of revolution along x with four fins.
    Torpedo,
    /// An open frame with floats on top.
    Frame,
    /// A perforated box.
    Lattice,
}

fn yellow() -> [f64; 3] {
    [0.96, 0.72, 0.11]
}

impl Default for Shape {
    fn default() -> Self {
        Self { kind: ShapeKind::Box, size: Vector3::repeat(1.0), position: Vector3::zeros(), colour: yellow() }
    }
}

impl Shape {
    /// Homogeneous box of this mass and inertia, or the cube of this volume.
    pub(super) fn homogeneous(body: &Body, water: &Water) -> Self {
        let inertia = body.inertia_about_com().diagonal();
        let squares = (0..3).map(|k| 6.0 * (inertia.sum() - 2.0 * inertia[k]) / body.mass);
        let squares = Vector3::from_iterator(squares);
        let volume = body.displaced_volume(water);
        let size = if squares.iter().all(|s| s.is_finite() && *s > 1e-8) {
            squares.map(f64::sqrt)
        } else {
            let volume = if volume > 0.0 { volume } else { body.mass / 1000.0 };
            Vector3::repeat(if volume > 0.0 { volume.cbrt() } else { 0.3 })
        };
        let position = if volume > 0.0 { body.center_of_buoyancy } else { body.center_of_mass };
        Self { size, position, ..Self::default() }
    }
}

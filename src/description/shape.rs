//! Shape of the vehicle in pictures.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::keys::numbers;

/// Shape of the vehicle in pictures, without influence on the physics. Default: the homogeneous box of its mass and inertia.
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

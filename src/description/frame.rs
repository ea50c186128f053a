//! Poses relative to a parent frame.

use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};

use crate::keys::numbers;

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

impl Frame {
    /// Frame at a position with a rotation from the frame to its parent; exact to rounding at every pitch.
    pub fn new(position: Vector3<f64>, r: &Matrix3<f64>) -> Self {
        let yaw = r[(1, 0)].atan2(r[(0, 0)]);
        let pitch = (-r[(2, 0)]).atan2(r[(0, 0)].hypot(r[(1, 0)]));
        let (sin, cos) = yaw.sin_cos();
        let roll = (sin * r[(0, 2)] - cos * r[(1, 2)]).atan2(cos * r[(1, 1)] - sin * r[(0, 1)]);
        Self { position, rpy: Vector3::new(roll, pitch, yaw) }
    }

    /// Rotation from this frame to the parent frame: `Rz(yaw) Ry(pitch) Rx(roll)`.
    pub fn rotation(&self) -> Matrix3<f64> {
        Rotation3::from_euler_angles(self.rpy.x, self.rpy.y, self.rpy.z).into_inner()
    }

    /// The frame `inner`, which is relative to this one, relative to this one's parent. All digits stay where one of them is at
    /// its parent.
    pub fn then(&self, inner: &Self) -> Self {
        if *self == Self::default() {
            return inner.clone();
        }
        let position = self.position + self.rotation() * inner.position;
        if inner.rpy == Vector3::zeros() {
            return Self { position, rpy: self.rpy };
        }
        Self::new(position, &(self.rotation() * inner.rotation()))
    }
}

//! The vehicle: a body with thrusters.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{Body, Shape, numbers};

/// The vehicle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vehicle {
    /// Name, for people.
    pub name: String,
    /// Held at its initial pose in the world: the arm then has a fixed base. `[HC eq. 27]`
    #[serde(default)]
    pub fixed: bool,
    /// Rigid body and hydrodynamics.
    pub body: Body,
    /// Thrusters, in the order of every thrust array.
    #[serde(default)]
    pub thrusters: Vec<Thruster>,
    /// Gains of the vehicle's PD station keeping.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub servo: Option<VehicleServo>,
    /// How pictures show it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shape: Option<Shape>,
}

/// One thruster: a force along an axis at a point. `[HC eq. 25]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thruster {
    /// Name, for people.
    pub name: String,
    /// Position in the vehicle frame, m.
    #[serde(with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Direction of the force that positive thrust puts on the vehicle; normalised on reading.
    #[serde(with = "numbers::vector3")]
    pub axis: Vector3<f64>,
    /// Least and greatest thrust, N.
    #[serde(with = "numbers::array")]
    pub limits: [f64; 2],
}

/// Gains of the paper's PD on the vehicle: `F = -kp e - kd V`, per body axis `[x y z; roll pitch yaw]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleServo {
    /// Proportional gains, N/m and N m/rad.
    #[serde(with = "numbers::array")]
    pub kp: [f64; 6],
    /// Derivative gains, N s/m and N m s/rad.
    #[serde(with = "numbers::array")]
    pub kd: [f64; 6],
}

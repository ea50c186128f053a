//! Motion that sensors read, and their mounting pose.

use nalgebra::{Matrix3, Vector3};

use crate::lie;

/// Motion of the vehicle's frame at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Time, s.
    pub time: f64,
    /// Origin in the world, m.
    pub position: Vector3<f64>,
    /// Rotation, body to world.
    pub rotation: Matrix3<f64>,
    /// Absolute velocity of the origin, body axes, m/s.
    pub linear: Vector3<f64>,
    /// Angular velocity, body axes, rad/s.
    pub angular: Vector3<f64>,
    /// Acceleration of gravity, world axes, m/s2.
    pub gravity: Vector3<f64>,
}

impl Motion {
    /// Position of a point of the vehicle in the world, m.
    pub fn point(&self, at: &Vector3<f64>) -> Vector3<f64> {
        self.position + self.rotation * at
    }

    /// Velocity of a point of the vehicle, body axes, m/s.
    pub fn velocity(&self, at: &Vector3<f64>) -> Vector3<f64> {
        self.linear + self.angular.cross(at)
    }
}

/// Mounting pose of a sensor on the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mount {
    /// Position in the vehicle's frame, m.
    pub position: Vector3<f64>,
    /// Rotation, sensor axes to body axes.
    pub rotation: Matrix3<f64>,
}

impl Mount {
    /// Mount at a position by roll, pitch and yaw about fixed axes, rad.
    pub fn new(position: [f64; 3], [roll, pitch, yaw]: [f64; 3]) -> Self {
        let about = |axis: Vector3<f64>, angle: f64| exponential(&(axis * angle));
        let rotation = about(Vector3::z(), yaw) * about(Vector3::y(), pitch) * about(Vector3::x(), roll);
        Self { position: position.into(), rotation }
    }
}

/// `exp [w]` of a rotation vector of length up to pi.
pub fn exponential(w: &Vector3<f64>) -> Matrix3<f64> {
    let turn = lie::Vector6 { linear: lie::Vector3([0.0; 3]), angular: lie::Vector3((*w).into()) };
    let rows = lie::exp_se3(turn).rotation.0;
    Matrix3::from_fn(|i, j| rows[i][j])
}

/// Rotation vector of a rotation, of length at most pi.
pub fn rotation_vector(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let rows = std::array::from_fn(|i| std::array::from_fn(|j| rotation[(i, j)]));
    lie::rotation_vector(&lie::Matrix3(rows)).0.into()
}

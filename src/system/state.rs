//! State of one instance.

use nalgebra::{Matrix3, Vector3, Vector6};

use crate::hydro::{THRUSTERS, Thrusts};

/// Maximum number of joints: q0 of joint loading and eight of the arm.
pub const JOINTS: usize = crate::description::MAX_JOINTS;

/// One number per joint; entries past the scene's joint count are 0.
pub type Joints = [f64; JOINTS];

/// Uniform flow of the water, world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flow {
    /// v_c, m/s.
    pub velocity: Vector3<f64>,
    /// a_c = v_c', m/s^2.
    pub acceleration: Vector3<f64>,
}

impl From<Vector3<f64>> for Flow {
    /// A steady current.
    fn from(velocity: Vector3<f64>) -> Self {
        Self { velocity, acceleration: Vector3::zeros() }
    }
}

/// State of one instance: `(T, V, q, q')`, thrusts and the time. `[HC eq. 17]`
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Vehicle origin in the world, m.
    pub position: Vector3<f64>,
    /// Body to world rotation.
    pub rotation: Matrix3<f64>,
    /// Absolute body twist `[v; omega]` at the vehicle frame, m/s and rad/s.
    pub twist: Vector6<f64>,
    /// Joint coordinates (q0 first where there is joint loading), rad or m.
    pub q: Joints,
    /// Joint rates, rad/s or m/s.
    pub qd: Joints,
    /// Thrust of each thruster in still water, N; 0 if the thrusters have no dynamics.
    pub thrust: Thrusts,
    /// Time since the start, s.
    pub time: f64,
}

impl Default for State {
    /// At rest at the origin, level, joints at 0.
    fn default() -> Self {
        Self {
            position: Vector3::zeros(),
            rotation: Matrix3::identity(),
            twist: Vector6::zeros(),
            q: [0.0; JOINTS],
            qd: [0.0; JOINTS],
            thrust: [0.0; THRUSTERS],
            time: 0.0,
        }
    }
}

//! Loads on one instance.

use nalgebra as na;

use crate::hydro::{FINS, THRUSTERS, Thrusts};
use crate::system::JOINTS;

/// Loads on one instance, held until they are set again.
#[derive(Debug, Clone, PartialEq)]
pub struct InstanceLoads {
    /// Wrench on the vehicle in its body frame, at the frame's origin, N and N m.
    pub wrench: [f64; 6],
    /// Commanded thrusts, N, where thrusters have dynamics; without dynamics their wrench is part of `wrench`.
    pub command: Thrusts,
    /// Deflections of the fins, rad.
    pub fins: [f64; FINS],
    /// Actuator torques, N m or N.
    pub torque: [f64; JOINTS],
    /// Servo targets: polynomials in the time since the step's call, constant term first, rad or m.
    pub target: [[f64; 4]; JOINTS],
    /// External wrenches on the links, each in its link frame, N and N m.
    pub links: [[f64; 6]; JOINTS],
    /// Target of the vehicle's servo: rotation and position, m.
    pub station: (na::Matrix3<f64>, na::Vector3<f64>),
}

impl Default for InstanceLoads {
    fn default() -> Self {
        Self {
            wrench: [0.0; 6],
            command: [0.0; THRUSTERS],
            fins: [0.0; FINS],
            torque: [0.0; JOINTS],
            target: [[0.0; 4]; JOINTS],
            links: [[0.0; 6]; JOINTS],
            station: (na::Matrix3::identity(), na::Vector3::zeros()),
        }
    }
}

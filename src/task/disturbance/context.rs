//! Context of disturbances: the scene's figures that they use.

use nalgebra::Vector3;

use crate::control::Allocation;
use crate::description::Scene;

/// Constants of a scene for disturbances.
#[derive(Debug, Clone, PartialEq)]
pub struct DisturbanceContext {
    /// Control period, s.
    pub period: f64,
    /// Maximum thrust along the weakest body axis that can be actuated by itself, N: the reference of forces given as
    /// shares.
    pub thrust: f64,
    /// Root mean square distance of the thrusters from the vehicle's origin, m.
    pub lever: f64,
    /// Acceleration of gravity, m/s^2.
    pub gravity: f64,
    /// Density of the water, kg/m^3.
    pub density: f64,
    /// Orthonormal, world axes: two horizontal ones and the one against gravity.
    pub level: [Vector3<f64>; 3],
    /// Number of thrusters.
    pub thrusters: usize,
    /// Number of joints.
    pub joints: usize,
    /// True where the direction against gravity is measured too.
    pub tilt: bool,
}

impl DisturbanceContext {
    /// Context for a scene whose vehicle has thrusters.
    pub fn new(scene: &Scene, allocation: &Allocation, level: [Vector3<f64>; 3], period: f64) -> Self {
        let forces = allocation.wrench_limits();
        let weakest = forces[..3].iter().copied().filter(|limit| *limit > 0.0).fold(f64::INFINITY, f64::min);
        let strongest = (0..allocation.count()).map(|i| allocation.range(i)).fold(0.0, f64::max);
        let thrusters = &scene.vehicle.thrusters;
        let squares: f64 = thrusters.iter().map(|thruster| thruster.position.norm_squared()).sum();
        Self {
            period,
            thrust: if weakest.is_finite() { weakest } else { strongest },
            lever: (squares / thrusters.len().max(1) as f64).sqrt(),
            gravity: scene.water.gravity.norm(),
            density: scene.water.density,
            level,
            thrusters: thrusters.len(),
            joints: scene.joints().count(),
            tilt: false,
        }
    }

    /// Context for a task that observes the direction against gravity, or not.
    pub fn measuring_up(self, tilt: bool) -> Self {
        Self { tilt, ..self }
    }

    /// Direction up to an elevation (rad, either way), from two shares in [0, 1).
    pub(super) fn direction(&self, [azimuth, elevation]: [f64; 2], steepest: f64) -> Vector3<f64> {
        let [forward, left, up] = self.level;
        let azimuth = std::f64::consts::TAU * azimuth;
        let elevation = steepest * (2.0 * elevation - 1.0);
        (forward * azimuth.cos() + left * azimuth.sin()) * elevation.cos() + up * elevation.sin()
    }
}

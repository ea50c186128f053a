//! Nominal model of resolved motion: state, and terms of the equations of motion in still water.

use nalgebra::{Vector3, Vector6};

use crate::description::Scene;
use crate::dynamics::{EquationsOfMotion, PassiveTorque, SerialChain, Velocities};
use crate::error::ControlError;
use crate::system::{JOINTS, Joints};

/// State of vehicle, arm and reference.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TrackingState {
    /// Pose error of the end effector, m and rad.
    pub error: Vector6<f64>,
    pub velocities: Velocities,
    /// Direction against gravity, vehicle axes, as measured: of length 1 but for noise.
    pub up: Vector3<f64>,
    pub q: Joints,
    /// Twist of the reference, end-effector axes.
    pub reference: Vector6<f64>,
    /// Its acceleration, m/s^2; the angular part is not observed.
    pub acceleration: Vector6<f64>,
}

/// The nominal model over a control period.
pub(super) struct NominalModel {
    chain: SerialChain,
    joints: usize,
    /// Control period, s.
    pub period: f64,
}

impl NominalModel {
    pub fn new(scene: &Scene, period: f64) -> Result<Self, ControlError> {
        let chain = SerialChain::new(scene).map_err(|error| ControlError::Model(error.to_string()))?;
        Ok(Self { chain, joints: scene.joints().count(), period })
    }

    /// Equations of motion, and the joints' passive torques.
    pub fn terms(&self, now: &TrackingState) -> (EquationsOfMotion, [PassiveTorque; JOINTS]) {
        let mut passive = [PassiveTorque::default(); JOINTS];
        for (k, passive) in passive.iter_mut().enumerate().take(self.joints) {
            *passive = self.chain.passive(k, now.q[k], now.velocities[6 + k]);
        }
        let up = now.up.try_normalize(0.0).unwrap_or_else(Vector3::z);
        (self.chain.at(&up, &now.q, &now.velocities), passive)
    }

    /// Decrease of a joint's passive torque per rate, over a period.
    pub fn joint_damping(&self, passive: &PassiveTorque) -> f64 {
        passive.damping + self.period * passive.stiffness
    }
}

//! Nominal model of resolved motion: state, and terms of the equations of motion in still water.

use std::cell::OnceCell;

use nalgebra::{Cholesky, Const, Vector3, Vector6};

use crate::description::Scene;
use crate::dynamics::{EquationsOfMotion, MassMatrix, PassiveTorque, SerialChain, VELOCITIES, Velocities};
use crate::error::ControlError;
use crate::system::{JOINTS, Joints};

/// State of vehicle, arm and reference.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::control) struct TrackingState {
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

/// Terms of the model at a state.
pub(in crate::control) struct ModelTerms {
    /// Equations of motion.
    pub motion: EquationsOfMotion,
    /// Passive torques of the joints.
    pub passive: [PassiveTorque; JOINTS],
    /// `M + T D` over a period T, D the decrease of the passive torques per rate.
    pub inertia: MassMatrix,
    /// Its factor, made when it is needed first; none where it is not positive definite, which does not happen.
    factor: OnceCell<Option<Cholesky<f64, Const<VELOCITIES>>>>,
}

impl ModelTerms {
    /// `(M + T D)^-1` times a force; 0 without a factor.
    pub fn solve(&self, force: &Velocities) -> Velocities {
        let factor = self.factor.get_or_init(|| self.inertia.cholesky());
        factor.as_ref().map_or_else(Velocities::zeros, |factor| factor.solve(force))
    }
}

/// The nominal model over a control period.
pub(in crate::control) struct NominalModel {
    chain: SerialChain,
    /// Number of joints.
    pub joints: usize,
    /// Control period, s.
    pub period: f64,
}

impl NominalModel {
    pub fn new(scene: &Scene, period: f64) -> Result<Self, ControlError> {
        let chain = SerialChain::new(scene).map_err(|error| ControlError::Model(error.to_string()))?;
        Ok(Self { chain, joints: scene.joints().count(), period })
    }

    /// Terms at a state.
    pub fn terms(&self, now: &TrackingState) -> ModelTerms {
        let mut passive = [PassiveTorque::default(); JOINTS];
        for (k, passive) in passive.iter_mut().enumerate().take(self.joints) {
            *passive = self.chain.passive(k, now.q[k], now.velocities[6 + k]);
        }
        let up = now.up.try_normalize(0.0).unwrap_or_else(Vector3::z);
        let motion = self.chain.at(&up, &now.q, &now.velocities);
        let mut inertia = motion.mass;
        for k in 0..self.joints {
            inertia[(6 + k, 6 + k)] += self.period * self.joint_damping(&passive[k]);
        }
        ModelTerms { motion, passive, inertia, factor: OnceCell::new() }
    }

    /// Decrease of a joint's passive torque per rate, over a period.
    pub fn joint_damping(&self, passive: &PassiveTorque) -> f64 {
        passive.damping + self.period * passive.stiffness
    }
}

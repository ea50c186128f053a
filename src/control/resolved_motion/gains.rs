//! Gains of resolved motion.

use serde::{Deserialize, Serialize};

/// Gains of [`ResolvedMotion`](super::ResolvedMotion).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResolvedMotionGains {
    /// Pose error to the end effector's commanded twist, 1/s.
    pub pose_gain: f64,
    /// Error of the vehicle's twist to its acceleration, 1/s.
    pub twist_gain: f64,
    /// Error of the joints' rates to their accelerations, 1/s.
    pub joint_gain: f64,
    /// Distance of the joints from home to their rates, in the null space of the end effector's motion, 1/s.
    pub posture_gain: f64,
    /// Tilt of the vehicle to its rates, in the same null space, 1/s.
    pub levelling_gain: f64,
    /// Joint weight relative to the vehicle's. At 1 a 1 m arm and the vehicle share a motion equally.
    pub arm_weight: f64,
    /// Share of the thrusters' nominal lag over a period that is compensated; only with an observer or a delay.
    pub lag_compensation: f64,
    /// Integral of the pose error, over `pose_gain`, 1/s; 0 for none.
    pub integral_gain: f64,
    /// Bandwidths of the disturbance observer: of forces and moments on the vehicle, and of torques on joints, rad/s; 0
    /// for none.
    pub observer_bandwidth: [f64; 3],
    /// Displacement of the end effector by a force on it, as the observer of the joints' torques finds it, m/N; 0 for none.
    pub compliance: f64,
    /// Age of measurements that the prediction compensates, control periods, at most [`MAX_DELAY`](crate::control::MAX_DELAY).
    pub delay: usize,
    /// Names of further end effectors, which are held still in the world at the poses where an episode begins.
    pub hold: Vec<String>,
}

impl Default for ResolvedMotionGains {
    fn default() -> Self {
        Self {
            pose_gain: 2.5,
            twist_gain: 6.0,
            joint_gain: 10.0,
            posture_gain: 0.5,
            levelling_gain: 0.5,
            arm_weight: 2.0,
            lag_compensation: 0.0,
            integral_gain: 0.0,
            observer_bandwidth: [0.0; 3],
            compliance: 0.0,
            delay: 0,
            hold: Vec::new(),
        }
    }
}

impl ResolvedMotionGains {
    /// True if an observer or a prediction is needed.
    pub(super) fn predicts(&self) -> bool {
        self.delay > 0 || self.observer_bandwidth.iter().any(|bandwidth| *bandwidth > 0.0)
    }
}

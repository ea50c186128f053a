//! Gains of MPC.

use serde::{Deserialize, Serialize};

use crate::control::observer::ObserverGains;

/// Gains of MPC: weights of the cost; pairs are linear and angular. Angles count by
/// [`ATTITUDE_LEVER`](crate::control::ATTITUDE_LEVER).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MpcGains {
    /// On velocities, s2.
    pub velocity: [f64; 2],
    /// On the wrench beyond the compensation of disturbances, forces and moments, over its limits, m2.
    pub effort: [f64; 2],
    /// On its change from one move to the next, m2.
    pub change: [f64; 2],
    /// Gains of the observer.
    #[serde(flatten)]
    pub observer: ObserverGains,
}

impl Default for MpcGains {
    fn default() -> Self {
        Self::new(ObserverGains::default())
    }
}

impl MpcGains {
    /// Default weights.
    pub fn new(observer: ObserverGains) -> Self {
        Self { velocity: [0.02; 2], effort: [0.03, 0.06], change: [0.01, 0.02], observer }
    }
}

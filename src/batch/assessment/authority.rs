//! Authority of the thrusters along each body axis.

use nalgebra::{Cholesky, DMatrix, Vector3};

use crate::batch::simulator::Simulator;
use crate::control::AXES;
use crate::system::State;

/// Force or moment along a body axis that thrusters reach.
#[derive(Debug, Clone, PartialEq)]
pub struct Authority {
    /// Name of the axis.
    pub axis: &'static str,
    /// Maximum force (N) or moment (N m) along the axis alone, in both directions; 0 where there is none.
    pub alone: f64,
    /// Maximum force or moment along the axis, forward and backward, whatever the thrusters do along the others.
    pub maximum: [f64; 2],
    /// Acceleration by `alone`, vehicle and arm as one body with the joints at home, m/s2 or rad/s2.
    pub acceleration: f64,
}

/// Authority along the six axes of a free vehicle with thrusters.
pub(super) fn authority(simulator: &Simulator) -> Vec<Authority> {
    let (scene, allocation) = (simulator.scene(), simulator.allocation());
    if scene.vehicle.fixed || allocation.count() == 0 {
        return Vec::new();
    }
    let state = State { q: scene.home(), ..State::default() };
    let form = simulator.closed_form_model.at(&state, Vector3::zeros());
    let mass: DMatrix<f64> = form.mass_matrix().view((0, 0), (6, 6)).into();
    let inverse = Cholesky::new(mass).map_or_else(|| DMatrix::zeros(6, 6), |mass| mass.inverse());
    let alone = allocation.wrench_limits();
    let entry = |k: usize| {
        let maximum = allocation.maximum(k);
        Authority { axis: AXES[k], alone: alone[k], maximum, acceleration: inverse[(k, k)] * alone[k] }
    };
    (0..6).map(entry).collect()
}

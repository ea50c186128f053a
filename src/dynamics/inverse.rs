//! What it takes to move, or to stay: inverse dynamics and trim.

use nalgebra::{DVector, Vector6};

use super::closed_form::{Balance, ClosedForm, Loads};
use crate::error::DynamicsError;
use crate::system::{Flow, State};

/// What must be applied.
#[derive(Debug, Clone, PartialEq)]
pub struct Effort {
    /// Wrench on the vehicle, body axes at its origin, N and N m; from the mooring where the vehicle is held.
    pub wrench: Vector6<f64>,
    /// Actuator torques, N m or N, (n).
    pub joint_torques: DVector<f64>,
}

impl ClosedForm<'_> {
    /// The vehicle wrench and actuator torques that, on top of `loads`, give `accelerations` `[V'; q'']`, (6+n).
    ///
    /// # Errors
    /// [`DynamicsError::Length`] where `accelerations` has another length than 6+n or a load fits neither the scene nor
    /// "none".
    pub fn inverse_dynamics(&self, accelerations: &DVector<f64>, loads: &Loads) -> Result<Effort, DynamicsError> {
        self.check_size("acceleration", accelerations)?;
        let missing = self.mass_matrix() * accelerations + self.bias() - self.generalized_force(loads)?;
        // The vehicle's block of W and the joints' of L are identities.
        Ok(Effort {
            wrench: missing.fixed_rows::<6>(0).into_owned(),
            joint_torques: missing.rows(6, self.joints()).into_owned(),
        })
    }
}

impl Balance {
    /// The vehicle wrench and actuator torques that hold the system at rest at the pose and joint coordinates of `state`
    /// (its velocities do not count) in a flow of the water, or in a steady current (world axes, m/s).
    ///
    /// # Errors
    /// None on a scene that composes.
    pub fn trim(&self, state: &State, flow: impl Into<Flow>) -> Result<Effort, DynamicsError> {
        let rest = State { twist: Vector6::zeros(), qd: Default::default(), ..state.clone() };
        let form = self.at(&rest, flow);
        form.inverse_dynamics(&DVector::zeros(6 + form.joints()), &Loads::default())
    }
}

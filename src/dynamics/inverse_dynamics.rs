//! Inverse dynamics and trim.

use nalgebra::{DVector, Vector6};

use super::closed_form::{ClosedForm, Loads};
use super::closed_form_model::ClosedFormModel;
use crate::error::DynamicsError;
use crate::system::{Flow, State};

/// Wrench on the vehicle and actuator torques.
#[derive(Debug, Clone, PartialEq)]
pub struct GeneralizedForce {
    /// Wrench on the vehicle, body axes at its origin, N and N m; supplied by the mooring of a fixed vehicle.
    pub wrench: Vector6<f64>,
    /// Actuator torques, N m or N, (n).
    pub joint_torques: DVector<f64>,
}

impl ClosedForm<'_> {
    /// Vehicle wrench and actuator torques that, on top of `loads`, give `accelerations` `[V'; q'']`, (6+n).
    ///
    /// # Errors
    /// [`DynamicsError::Length`] for `accelerations` of another length than 6+n, or a nonempty load whose length does not
    /// match the scene.
    pub fn inverse_dynamics(
        &self,
        accelerations: &DVector<f64>,
        loads: &Loads,
    ) -> Result<GeneralizedForce, DynamicsError> {
        self.check_size("acceleration", accelerations)?;
        let missing = self.mass_matrix() * accelerations + self.bias() - self.generalized_force(loads)?;
        // The vehicle's block of W and the joints' block of L are identities.
        Ok(GeneralizedForce {
            wrench: missing.fixed_rows::<6>(0).into_owned(),
            joint_torques: missing.rows(6, self.joints()).into_owned(),
        })
    }
}

impl ClosedFormModel {
    /// Vehicle wrench and actuator torques that hold the system at rest at the pose and joint coordinates of `state`, whose
    /// velocities are ignored, in a flow of the water or a steady current (world axes, m/s).
    ///
    /// # Errors
    /// Never for a valid model.
    pub fn trim(&self, state: &State, flow: impl Into<Flow>) -> Result<GeneralizedForce, DynamicsError> {
        let rest = State { twist: Vector6::zeros(), qd: Default::default(), ..state.clone() };
        let form = self.at(&rest, flow);
        form.inverse_dynamics(&DVector::zeros(6 + form.joints()), &Loads::default())
    }
}

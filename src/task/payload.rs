//! Impact of a payload's grasp.

use nalgebra::{DVector, Matrix6};

use crate::dynamics::ClosedFormModel;
use crate::system::{Flow, State};

/// Velocities `nu = [V; q']` after the end effector has grasped a point mass at rest: `(M + J^T A_p J) nu+ = M nu-` with the
/// added mass in M.
pub fn grasp_impulse(model: &ClosedFormModel, state: &mut State, mass: f64) {
    let form = model.at(state, Flow::from(nalgebra::Vector3::zeros()));
    let n = form.joints();
    let before = DVector::from_iterator(6 + n, state.twist.iter().chain(&state.qd[..n]).copied());
    let (inertia, jacobian) = (form.mass_matrix(), form.jacobian());
    let mut point = Matrix6::zeros();
    (0..3).for_each(|k| point[(k, k)] = mass);
    let together = inertia + jacobian.transpose() * point * &jacobian;
    let Some(factors) = together.cholesky() else { return };
    let after = factors.solve(&(inertia * before));
    state.twist.copy_from(&after.fixed_rows::<6>(0));
    state.qd[..n].copy_from_slice(&after.as_slice()[6..]);
}

//! Equations of motion in Fossen's form: `M nu' + C(nu) nu + D(nu) nu + g(eta) = tau`. `[F21 sections 6.3, 10.3]`
//!
//! nu is the velocity relative to the water, `[V_r; q']` with `V_r = V - [R^T v_c; 0]`. In the frame that moves with a uniform
//! current the equations hold in this one form, with rigid and added mass in one M and one C; `nu' = [V_r'; q'']` with
//!
//! ```text
//! V_r' = V' + [omega x R^T v_c - R^T a_c; 0]
//! ```
//!
//! and with gravity less the acceleration a_c of the water in g. Without current, nu is `[V; q']` itself.

use nalgebra::{DMatrix, DVector, Vector6};

use super::closed_form::ClosedForm;
use crate::error::DynamicsError;
use crate::system::{Flow, State};

/// Terms of `M nu' + C(nu) nu + D(nu) nu + g(eta) = tau`, rows `[vehicle wrench at its origin; joints]`, N, N m and N.
///
/// tau holds everything else: `tau = W (thrust + fins + tether + external) + L command`.
#[derive(Debug, Clone, PartialEq)]
pub struct FossenForm {
    /// nu, (6+n), m/s and rad/s.
    pub velocity: DVector<f64>,
    /// M, (6+n, 6+n): rigid and added mass.
    pub mass_matrix: DMatrix<f64>,
    /// `C(nu) nu`, (6+n): Coriolis and centripetal terms of rigid and added mass, Munk moment included.
    pub coriolis: DVector<f64>,
    /// `D(nu) nu`, (6+n): linear and quadratic damping, joint friction and the damping of end stops. It opposes the motion:
    /// `nu^T D(nu) nu >= 0` for dissipative coefficients.
    pub damping: DVector<f64>,
    /// `g(eta)`, (6+n): minus the force of weight, buoyancy, springs, detents and the elastic end stops; the gradient of the
    /// potential energy along body twist and joint coordinates where the water does not accelerate.
    pub restoring: DVector<f64>,
}

impl FossenForm {
    /// The same in Fossen's body axes, x forward, y starboard, z down: `T M T` and `T x` with
    /// `T = diag(1, -1, -1, 1, -1, -1, I_n)`. Joint coordinates stay as they are.
    pub fn in_ned_axes(mut self) -> Self {
        let sign = |k: usize| if matches!(k, 1 | 2 | 4 | 5) { -1.0 } else { 1.0 };
        for column in 0..self.velocity.len() {
            for row in 0..self.velocity.len() {
                self.mass_matrix[(row, column)] *= sign(row) * sign(column);
            }
        }
        for vector in [&mut self.velocity, &mut self.coriolis, &mut self.damping, &mut self.restoring] {
            vector.iter_mut().enumerate().for_each(|(k, x)| *x *= sign(k));
        }
        self
    }
}

impl ClosedForm<'_> {
    /// Terms of Fossen's form at the present attitude and joint coordinates, with `velocity` (6+n) in place of the present
    /// `[V_r; q']` if it is given. Rows of a fixed vehicle hold with its mooring's wrench in tau.
    ///
    /// # Errors
    /// [`DynamicsError::Length`] for a `velocity` of another length than 6+n.
    pub fn fossen_form(&self, velocity: Option<&DVector<f64>>) -> Result<FossenForm, DynamicsError> {
        let n = self.joints();
        let velocity = match velocity {
            Some(given) => {
                self.check_size("velocity", given)?;
                given.clone()
            }
            None => DVector::from_iterator(6 + n, self.relative_twist(0).iter().chain(self.qd.iter()).copied()),
        };
        let mut state = State { position: self.pose.position, rotation: self.pose.rotation, ..State::default() };
        state.twist = Vector6::from_iterator(velocity.iter().copied());
        state.q[..n].copy_from_slice(self.q.as_slice());
        state.qd[..n].copy_from_slice(&velocity.as_slice()[6..]);
        // Still water, in the frame that moves with the current.
        let still = Flow::from(nalgebra::Vector3::zeros());
        let form = self.model.at(&state, still);
        let influence = form.wrench_influence();
        let stops: Vec<_> = form.end_stops().collect();
        let (friction, springs) = (form.friction(), form.springs().map(|(torque, _)| torque).collect::<Vec<_>>());
        let generalized = |wrenches: &[Vector6<f64>], torque: &dyn Fn(usize) -> f64| {
            let stacked = DVector::from_iterator(6 * wrenches.len(), wrenches.iter().flatten().copied());
            let mut force = &influence * stacked;
            (0..n).for_each(|i| force[6 + i] += torque(i));
            // A difference from 0 has no negative zeros.
            force.map(|f| 0.0 - f)
        };
        let gravity = self.model.gravity - self.flow.acceleration;
        let mut damping = form.damping();
        let of_terms = self.model.vehicle.damping_terms().into_array();
        for (wrench, is_damping) in form.term_wrenches(&[]).into_array().into_iter().zip(of_terms) {
            damping[0] += if is_damping { wrench } else { Vector6::zeros() };
        }
        Ok(FossenForm {
            damping: generalized(&damping, &|i| friction[i] + stops[i].damping),
            restoring: generalized(&form.restoring_in(&gravity), &|i| stops[i].elastic + springs[i]),
            coriolis: form.bias().clone(),
            mass_matrix: form.mass_matrix().clone(),
            velocity,
        })
    }
}

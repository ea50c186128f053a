//! `uvms_gym.Simulator.equations`.

use nalgebra::DVector;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::Given;
use super::model::{by_rows, dict};
use super::simulator::Simulator;

#[pymethods]
impl Simulator {
    /// Equations of motion in Fossen's form, `M nu' + C(nu) nu + D(nu) nu + g(eta) = tau`. [F21 sections 6.3, 10.3]
    ///
    /// nu = [V_r; q'] holds the body twist relative to the water, V_r = V - [R^T v_c; 0], and the joint rates. The
    /// equations hold with nu' = [V_r'; q''] and V_r' = V' + [omega x R^T v_c - R^T a_c; 0], where V' and q'' are those of
    /// `forward_dynamics`; in still water nu = [V; q']. Rows are the wrench on the vehicle at its origin and the joints.
    ///
    /// tau holds everything else, tau = W (thrust + fins + tether + external) + L command, with W and L of
    /// `wrench_influence` and `torque_influence`, the wrenches of `body_wrenches` and the torques of `joint_torques`. The
    /// first six rows of a fixed vehicle hold with the wrench of its mooring in tau.
    ///
    /// Parameters
    /// ----------
    /// nu : array_like (6 + n,) or (N, 6 + n), optional
    ///     Velocity [V_r; q'] in place of the present one, m/s and rad/s, in `axes`.
    /// axes : {"flu", "ned"}
    ///     Body axes of the vehicle: x forward, y left, z up; or Fossen's, x forward, y starboard, z down, which give
    ///     S M S and S x with S = diag(1, -1, -1, 1, -1, -1) on the vehicle's rows and columns.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray
    ///     nu (N, 6 + n): the velocity, m/s and rad/s; M (N, 6 + n, 6 + n): rigid and added mass, kg, kg m and kg m2;
    ///     C_nu (N, 6 + n): the product C(nu) nu, N and N m, Munk moment included; D_nu (N, 6 + n): the product D(nu) nu of
    ///     linear and quadratic damping, joint friction and damping of end stops, against the motion: 0 at nu = 0;
    ///     g (N, 6 + n): minus the force of weight, buoyancy and elastic end stops, the gradient of the potential energy;
    ///     with gravity less a_c where the water accelerates by a_c.
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     `nu` has the wrong shape or type, or is not finite; `axes` is neither "flu" nor "ned".
    #[pyo3(signature = (nu=None, *, axes="flu"))]
    fn equations<'py>(&self, py: Python<'py>, nu: Given, axes: &str) -> PyResult<Bound<'py, PyDict>> {
        let ned = match axes {
            "flu" => false,
            "ned" => true,
            _ => return Err(PyValueError::new_err(format!("axes is {axes:?}, but must be \"flu\" or \"ned\""))),
        };
        let width = 6 + self.inner.joints();
        let mut given = nu.map(|nu| self.finite_rows("nu", nu, width)).transpose()?;
        if let (Some(given), true) = (&mut given, ned) {
            given.chunks_exact_mut(width).for_each(|row| [1, 2, 4, 5].into_iter().for_each(|k| row[k] = -row[k]));
        }
        let shapes: [&[usize]; 5] = [&[width], &[width, width], &[width], &[width], &[width]];
        let arrays = self.each(py, shapes, |i, form| {
            let nu = given.as_ref().map(|rows| DVector::from_column_slice(&rows[i * width..(i + 1) * width]));
            let form = form.fossen_form(nu.as_ref())?;
            let form = if ned { form.in_ned_axes() } else { form };
            let [nu, coriolis, damping, restoring] =
                [form.velocity, form.coriolis, form.damping, form.restoring].map(|x| x.as_slice().to_vec());
            Ok([nu, by_rows(&form.mass_matrix), coriolis, damping, restoring])
        })?;
        dict(py, ["nu", "M", "C_nu", "D_nu", "g"], arrays)
    }
}

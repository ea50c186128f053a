//! `uvms_gym.Simulator.linearize`.

use pyo3::prelude::*;

use super::arrays::{Array, Given, array};
use super::computation::interruptible;
use super::errors::OrRaise;
use super::inputs::InputArguments;
use super::simulator::Simulator;

#[pymethods]
impl Simulator {
    /// Linearization `z' = A z + B u` about the present states, exact to rounding.
    ///
    /// `z = [xi; dq; dV; dq']` with the pose error xi (6) in body axes, `T = T_0 exp xi`, and the absolute body twist
    /// V; `u = [dF; dtau]` with the wrench F (6) on the vehicle, body axes at its origin, and the joint torques tau.
    /// About a moving vehicle `xi' = dV - ad_V0 xi`. Servos are off, a saturated actuator has derivative 0,
    /// thrusters with a lag are settled. Differentiated by dual numbers through the articulated-body algorithm. [PC05]
    ///
    /// Parameters
    /// ----------
    /// thrust, wrench, joint_torque, external, fin
    ///     Inputs of the motion of reference, as in `step`.
    ///
    /// Returns
    /// -------
    /// A : numpy.ndarray (N, 12 + 2n, 12 + 2n)
    /// B : numpy.ndarray (N, 12 + 2n, 6 + n)
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     An input has the wrong shape or type, or is not finite.
    #[pyo3(signature = (*, thrust=None, wrench=None, joint_torque=None, external=None, fin=None))]
    fn linearize<'py>(
        &self,
        py: Python<'py>,
        thrust: Given,
        wrench: Given,
        joint_torque: Given,
        external: Given,
        fin: Given,
    ) -> PyResult<(Array<'py>, Array<'py>)> {
        let given = InputArguments { thrust, wrench, joint_torque, external, fin, ..Default::default() };
        let arrays = given.read(&self.inner)?;
        let (simulator, instances) = (&self.inner, self.inner.instances());
        let [a, b] = interruptible(py, || simulator.linearizations(&arrays.inputs()))?.or_raise()?;
        let rates = 6 + simulator.joints();
        Ok((array(py, &[instances, 2 * rates, 2 * rates], a)?, array(py, &[instances, 2 * rates, rates], b)?))
    }
}

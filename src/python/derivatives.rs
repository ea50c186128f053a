//! `uvms_gym.Simulator`: linearization, and derivatives of steps.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{Array, Given, array, count, rows};
use super::computation::{exclusive, interruptible};
use super::errors::OrRaise;
use super::inputs::{Keywords, StepInputs};
use super::simulator::Simulator;
use uvms_gym::batch::{Argument, parameter};

/// Inputs, number of steps and parameters of a call.
struct Call {
    given: StepInputs,
    substeps: usize,
    parameters: Vec<usize>,
}

impl Call {
    fn read(
        simulator: &Simulator,
        inputs: Option<Keywords>,
        substeps: Given,
        parameters: Option<Vec<String>>,
    ) -> PyResult<Self> {
        let substeps = substeps.map_or(Ok(1), |n| count("substeps", n))?;
        let parameters = parameters.unwrap_or_default();
        let parameters = parameters.iter().map(|name| parameter(name)).collect::<Result<_, _>>().or_raise()?;
        Ok(Self { given: StepInputs::read(&simulator.inner, inputs)?, substeps, parameters })
    }

    fn arguments(&self, simulator: &Simulator) -> Vec<(Argument, usize)> {
        simulator.inner.arguments(&self.given.inputs(), self.parameters.len())
    }

    /// Arrays by arguments, (N, w), or (N, size, w) of Jacobians, of the numbers of all arguments.
    fn dict<'py>(
        &self,
        py: Python<'py>,
        simulator: &Simulator,
        size: usize,
        numbers: &[f64],
    ) -> PyResult<Bound<'py, PyDict>> {
        let (dict, instances, arguments) = (PyDict::new(py), simulator.inner.instances(), self.arguments(simulator));
        let (all, mut first): (usize, _) = (arguments.iter().map(|(_, width)| width).sum(), 0);
        for (argument, width) in arguments {
            let columns = numbers.chunks_exact(all).flat_map(|row| &row[first..first + width]).copied().collect();
            let shape = [instances, size, width];
            let shape = if size == 0 { &[instances, width][..] } else { &shape };
            dict.set_item(argument.name(), array(py, shape, columns)?)?;
            first += width;
        }
        Ok(dict)
    }
}

#[pymethods]
impl Simulator {
    /// int: coordinates s of the state in `step_jacobians`: `12 + 2 n`, and m more where thrusters have dynamics.
    #[getter]
    fn state_size(&self) -> usize {
        self.inner.state_size()
    }

    /// Jacobians of the step: derivatives of the state after `substeps` steps of `dt` under held inputs. Exact to rounding; the
    /// instances are not stepped. See docs/gradients.md.
    ///
    /// Differentiated by dual numbers through the kernel of `step`, whatever its integrator. Coordinates of the state, s of them:
    /// `[xi (6); dq (n); dV (6); dq' (n); dT (m)]` with the pose `T exp(xi)` (m and rad, body axes of the pose), the absolute
    /// body twist V, and the thrusts T of thrusters with dynamics (absent without). Rows are coordinates of the state after the
    /// steps, columns are coordinates of the argument before. Rows and columns of the twist are 0 where the vehicle is fixed.
    ///
    /// Saturated actuators have derivative 0, also exactly at their limit. At other kinks the derivative is one-sided; |v| has
    /// derivative 0 at 0. Sub-intervals of a step are constant. An instance whose state becomes NaN has derivatives NaN. With dtype="float32" the
    /// step in double precision is differentiated, from the present state and factors. The GIL is released; Ctrl-C interrupts.
    ///
    /// Parameters
    /// ----------
    /// substeps : int
    ///     Number of steps of `dt`.
    /// parameters : sequence of str
    ///     Names of factors (see `scale_parameters`): "mass", "added_mass", "linear_damping", "quadratic_damping", "volume",
    ///     "payload" (per kg), "thrust", "thruster_lag".
    /// **inputs : StepInputs
    ///     Inputs, as in `step`: thrust, wrench, joint_torque, joint_target, external, pose_target, fin. The steps are
    ///     differentiated with respect to each input that is given.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray
    ///     "state" (N, s, s); under the name of each input given (N, s, w), where w is m, 6, n, n k (by joints), 6 (n + 1) (by
    ///     bodies), 6 (target pose `T_d exp(xi)`) or k; "parameters" (N, s, p), if any, in the order given.
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     An input has the wrong shape or type, or is not finite; a parameter is unknown; the
    ///     integrator is a baseline method with Euler angles, quaternions or lagged added mass; the machine has neither AVX2
    ///     nor NEON.
    /// MemoryError
    ///     The result does not fit into memory.
    #[pyo3(
        signature = (*, substeps=None, parameters=None, **inputs),
        text_signature = "($self, *, substeps=1, parameters=(), **inputs)"
    )]
    fn step_jacobians<'py>(
        slf: &Bound<'py, Self>,
        substeps: Given,
        parameters: Option<Vec<String>>,
        inputs: Option<Keywords>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (py, this) = (slf.py(), &mut *exclusive(slf)?);
        let call = Call::read(this, inputs, substeps, parameters)?;
        let inner = &mut this.inner;
        let run = || inner.step_jacobians(&call.given.inputs(), call.substeps, &call.parameters);
        let jacobians = interruptible(py, run)?.or_raise()?;
        call.dict(py, this, jacobians.size, &jacobians.numbers)
    }

    /// Product of the Jacobian of the step with a tangent: one column of cost instead of all, whatever the number of arguments.
    ///
    /// Parameters
    /// ----------
    /// tangents : dict of array_like (w,) or (N, w)
    ///     Tangents by the keys of `step_jacobians`, in its coordinates; absent ones are 0.
    /// substeps, parameters, **inputs
    ///     As in `step_jacobians`.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, s)
    ///     Sum over the arguments of Jacobian times tangent.
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     As `step_jacobians`; a tangent has the wrong shape, or its argument is not given.
    #[pyo3(
        signature = (tangents, *, substeps=None, parameters=None, **inputs),
        text_signature = "($self, tangents, *, substeps=1, parameters=(), **inputs)"
    )]
    fn step_jvp<'py>(
        slf: &Bound<'py, Self>,
        tangents: &Bound<'py, PyDict>,
        substeps: Given,
        parameters: Option<Vec<String>>,
        inputs: Option<Keywords>,
    ) -> PyResult<Array<'py>> {
        let (py, this) = (slf.py(), &mut *exclusive(slf)?);
        let call = Call::read(this, inputs, substeps, parameters)?;
        let arguments = call.arguments(this);
        let known = || arguments.iter().map(|(argument, _)| argument.name());
        for key in tangents.keys() {
            let name: String = key.extract()?;
            if !known().any(|known| known == name) {
                let known = known().collect::<Vec<_>>().join(", ");
                return Err(PyValueError::new_err(format!("tangents: no argument '{name}' in this call: {known}")));
            }
        }
        let instances = this.inner.instances();
        let mut parts = Vec::new();
        for &(argument, width) in &arguments {
            let name = argument.name();
            let part = match tangents.get_item(name)? {
                Some(given) => rows(&format!("tangents['{name}']"), &given, instances, &[width])?,
                None => vec![0.0; instances * width],
            };
            parts.push((part, width));
        }
        let row = |i: usize| parts.iter().flat_map(move |(part, width)| &part[i * width..][..*width]);
        let numbers: Vec<f64> = (0..instances).flat_map(row).copied().collect();
        let inner = &mut this.inner;
        let run = || inner.step_jvp(&call.given.inputs(), call.substeps, &call.parameters, &numbers);
        let product = interruptible(py, run)?.or_raise()?;
        array(py, &[instances, this.inner.state_size()], product)
    }

    /// Product of a cotangent of the next state with the Jacobian of the step: the gradient of a scalar by state, inputs and
    /// parameters from that by the next state. By the adjoint of the step, in a few times its time whatever the number of columns; the
    /// record of the steps takes some 0.6 kB a step for each instance in the lanes.
    ///
    /// Parameters
    /// ----------
    /// cotangents : array_like (s,) or (N, s)
    ///     Derivatives of the scalar by the next state, in the coordinates of `step_jacobians`.
    /// substeps, parameters, **inputs
    ///     As in `step_jacobians`.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray (N, w)
    ///     Cotangent times Jacobian, by the keys of `step_jacobians`.
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     As `step_jacobians`; the cotangents have the wrong shape.
    /// MemoryError
    ///     The record of the steps does not fit into memory.
    #[pyo3(
        signature = (cotangents, *, substeps=None, parameters=None, **inputs),
        text_signature = "($self, cotangents, *, substeps=1, parameters=(), **inputs)"
    )]
    fn step_vjp<'py>(
        slf: &Bound<'py, Self>,
        cotangents: &Bound<'py, PyAny>,
        substeps: Given,
        parameters: Option<Vec<String>>,
        inputs: Option<Keywords>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (py, this) = (slf.py(), &mut *exclusive(slf)?);
        let call = Call::read(this, inputs, substeps, parameters)?;
        let cotangents = rows("cotangents", cotangents, this.inner.instances(), &[this.inner.state_size()])?;
        let inner = &mut this.inner;
        let run = || inner.step_vjp(&call.given.inputs(), call.substeps, &call.parameters, &cotangents);
        let product = interruptible(py, run)?.or_raise()?;
        call.dict(py, this, 0, &product)
    }

    /// Linearization `z' = A z + B u` about the present states, exact to rounding.
    ///
    /// `z = [xi; dq; dV; dq']` with the pose error xi (6) in body axes, `T = T_0 exp xi`, and the absolute body twist
    /// V; `u = [dF; dtau]` with the wrench F (6) on the vehicle, body axes at its origin, and the joint torques tau.
    /// About a moving vehicle `xi' = dV - ad_V0 xi`. Servos are off, a saturated actuator has derivative 0,
    /// thrusters with a lag are settled. Differentiated by dual numbers through the articulated-body algorithm. [PC05]
    ///
    /// Parameters
    /// ----------
    /// **inputs : StepInputs
    ///     Inputs of the motion of reference, as in `step`: thrust, wrench, joint_torque, external, fin.
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
    #[pyo3(signature = (**inputs))]
    fn linearize<'py>(&self, py: Python<'py>, inputs: Option<Keywords>) -> PyResult<(Array<'py>, Array<'py>)> {
        let allowed = ["thrust", "wrench", "joint_torque", "external", "fin"];
        let given = StepInputs::read_some(&self.inner, inputs, &allowed)?;
        let (simulator, instances) = (&self.inner, self.inner.instances());
        let [a, b] = interruptible(py, || simulator.linearizations(&given.inputs()))?.or_raise()?;
        let rates = 6 + simulator.joints();
        Ok((array(py, &[instances, 2 * rates, 2 * rates], a)?, array(py, &[instances, 2 * rates, rates], b)?))
    }
}

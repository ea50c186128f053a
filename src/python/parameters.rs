//! `uvms_gym.Simulator`: parameters of single instances.

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

use super::arrays::{array, read, wrong_shape};
use super::computation::exclusive;
use super::errors::OrRaise;
use super::inputs::Keywords;
use super::simulator::Simulator;
use uvms_gym::batch::parameter;
use uvms_gym::system::Factors;

#[pymethods]
impl Simulator {
    /// Factors on the scene's parameters, per instance, all 1 unless set; and payloads, 0 unless set.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray (N,)
    ///     mass, added_mass, linear_damping, quadratic_damping, volume, payload, thrust, thruster_lag: see `scale_parameters`.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let instances = self.inner.instances();
        let factors: Vec<_> = (0..instances).map(|i| self.inner.factors(i).to_array()).collect();
        let dict = PyDict::new(py);
        for (k, name) in Factors::<f64>::NAMES.into_iter().enumerate() {
            dict.set_item(name, array(py, &[instances], factors.iter().map(|f| f[k]).collect())?)?;
        }
        Ok(dict)
    }

    /// Set factors on the parameters of every body of each instance, for domain randomisation.
    ///
    /// `reset` does not change them. Factors that are not given stay as they are.
    ///
    /// Parameters
    /// ----------
    /// mass : array_like () or (N,)
    ///     Factor on mass, and with it inertia and weight. Positive.
    /// added_mass : array_like () or (N,)
    ///     Factor on added mass.
    /// linear_damping, quadratic_damping : array_like () or (N,)
    ///     Factors on damping coefficients; that on linear damping also scales damping by forward speed.
    /// volume : array_like () or (N,)
    ///     Factor on displaced volume, and with it buoyancy.
    /// payload : array_like () or (N,)
    ///     Point mass at the end effector (at the vehicle's origin without an arm), kg; on top of the scene's payload.
    /// thrust : array_like () or (N,)
    ///     Factor on the thrust relative to the commanded thrust.
    /// thruster_lag : array_like () or (N,)
    ///     Factor on the thrusters' time constants, where the scene has any.
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     A factor is unknown, has the wrong shape or type, is negative or not finite; nothing has changed then.
    #[pyo3(signature = (**factors))]
    fn scale_parameters(slf: &Bound<'_, Self>, factors: Option<Keywords>) -> PyResult<()> {
        let this = &mut *exclusive(slf)?;
        let instances = this.inner.instances();
        let mut rows: Vec<_> = (0..instances).map(|i| this.inner.factors(i).to_array()).collect();
        for (key, given) in factors.into_iter().flatten() {
            let name = key.cast::<PyString>()?.to_str()?;
            let k = parameter(name).or_raise()?;
            if given.is_none() {
                continue;
            }
            let (shape, numbers) = read(name, &given)?;
            if !shape.is_empty() && shape != [instances] {
                return Err(wrong_shape(name, &shape, &format!("() or ({instances},)")));
            }
            for (row, number) in rows.iter_mut().zip(numbers.iter().cycle()) {
                row[k] = *number;
            }
        }
        let factors: Vec<_> = rows.into_iter().map(Factors::from_array).collect();
        this.inner.set_factors(&factors).or_raise()
    }
}

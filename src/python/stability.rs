//! `uvms_gym.integrators`; `uvms_gym.Simulator`: modes, stable steps, and step warnings.

use std::ffi::CString;
use std::fmt::Display;

use nalgebra::Complex;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyComplex, PyDict};

use super::arrays::{Given, dict, read, wrong_shape};
use super::computation::detached;
use super::errors::{OrRaise, StepWarning};
use super::simulator::Simulator;
use uvms_gym::batch::{ModalAnalysis, stabilities};
use uvms_gym::dynamics::Servos;
use uvms_gym::integrate::{Integrator, IntegratorKind, NamedIntegrator};

/// List the integrators of `Simulator`, the default first.
///
/// Returns
/// -------
/// list of dict
///     Each with name (str), summary (str), order (int: the error after a given time falls as dt to this power), kind
///     (str: "production", or "baseline" for methods of other simulators, for comparison), adaptive (bool: divides steps into
///     sub-intervals by their estimated error, see `tolerance`) and implicit (bool: solves a linear system within a step).
#[pyfunction]
pub fn integrators(py: Python<'_>) -> PyResult<Vec<Bound<'_, PyDict>>> {
    let entry = |NamedIntegrator { name, summary, integrator, kind, .. }: NamedIntegrator| {
        Ok(dict! { py;
            "name": name,
            "summary": summary,
            "order": integrator.order(),
            "kind": match kind { IntegratorKind::Production => "production", IntegratorKind::Baseline => "baseline" },
            "adaptive": integrator.adaptive(),
            "implicit": integrator.implicit(),
        })
    };
    Integrator::NAMES.into_iter().map(entry).collect()
}

/// Packages whose frames a warning skips.
const BETWEEN: [&str; 3] = ["uvms_gym", "gymnasium", "stable_baselines3"];

/// Issues a warning, if there is one, as a `StepWarning` at the user's line.
pub fn warn(py: Python<'_>, warning: Option<impl Display>) -> PyResult<()> {
    let Some(warning) = warning else { return Ok(()) };
    let category = py.get_type::<StepWarning>();
    let message = CString::new(warning.to_string().replace('\0', ""))?;
    PyErr::warn(py, &category, &message, users_level(py)?)
}

/// Stack level of the user's frame for `warnings.warn`.
fn users_level(py: Python<'_>) -> PyResult<i32> {
    let mut frame = py.import(intern!(py, "sys"))?.call_method0(intern!(py, "_getframe"))?;
    let mut level = 1;
    while !frame.is_none() {
        let module = frame.getattr(intern!(py, "f_globals"))?.call_method1(intern!(py, "get"), ("__name__", ""))?;
        let module: String = module.extract().unwrap_or_default();
        if !BETWEEN.contains(&module.split('.').next().unwrap_or_default()) {
            return Ok(level);
        }
        frame = frame.getattr(intern!(py, "f_back"))?;
        level += 1;
    }
    Ok(level)
}

/// One speed for all axes, or one for each.
pub fn speeds(given: Given) -> PyResult<Option<[f64; 6]>> {
    let Some(given) = given else { return Ok(None) };
    match read("speed", given)? {
        (shape, numbers) if shape.is_empty() => Ok(Some([numbers[0]; 6])),
        (shape, numbers) if shape == [6] => Ok(numbers.try_into().ok()),
        (shape, _) => Err(wrong_shape("speed", &shape, "() or (6,)")),
    }
}

impl Simulator {
    /// A result of the scene's modal analysis, computed without the GIL.
    fn analyse<R: Send>(
        &self,
        py: Python<'_>,
        speed: Given,
        result: impl FnOnce(&ModalAnalysis) -> R + Send,
    ) -> PyResult<R> {
        let (simulator, speed) = (&self.inner, speeds(speed)?);
        detached(py, || simulator.modal_analysis(speed.as_ref()).map(|analysis| result(&analysis)))?.or_raise()
    }
}

#[pymethods]
impl Simulator {
    /// Modes of the scene: small deviations that decay, oscillate or grow; fastest first.
    ///
    /// Eigenvalues of the linearized motion (damping, restoring, friction, servos, gyroscopic terms) at a spread of states:
    /// at home and at 8 configurations within the limits of the joints, each at rest, with the vehicle at its expected
    /// speed through the water along each axis in turn (of a fixed vehicle, the water past it), and with all joints at their
    /// speed limits (1 rad/s or 0.25 m/s without); and with each joint against each of its end stops, whose stiffness acts only there. For each
    /// coordinate, of the modes in which it has most of the kinetic energy, the list has the fastest decaying one, the fastest
    /// growing one, and the fastest one at an end stop. All without the factors of `scale_parameters`.
    ///
    /// Parameters
    /// ----------
    /// speed : float or array_like (6,)
    ///     Expected speed through the water, m/s and rad/s, along all axes or along each. By default the speed at which full
    ///     thrust along the axis balances the vehicle's damping, at most 5, or the speed of the scene's current, from any
    ///     heading, where that is greater.
    /// joint_servos, vehicle_servo : bool
    ///     True where the servos of the joints and of the vehicle are on, if the scene has them.
    ///
    /// Returns
    /// -------
    /// list of dict
    ///     rate (complex, 1/s, one of each conjugate pair: deviations go as exp(rate t)), time_constant (1/|real part|,
    ///     s), period (s; infinite without oscillation), what (moving coordinates: "joint 3 (wrist)"), where (state of
    ///     the linearization), end_stop (bool).
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     Speed that is negative, not finite or not a number.
    #[pyo3(
        signature = (speed=None, *, joint_servos=true, vehicle_servo=true),
        text_signature = "($self, speed=None, *, joint_servos=True, vehicle_servo=True)"
    )]
    fn modes<'py>(
        &self,
        py: Python<'py>,
        speed: Given,
        joint_servos: bool,
        vehicle_servo: bool,
    ) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let servos = Servos { joints: joint_servos, vehicle: vehicle_servo };
        let mut list = Vec::new();
        for mode in self.analyse(py, speed, |analysis| analysis.modes(servos))? {
            let Complex { re, im } = mode.rate;
            list.push(dict! { py;
                "rate": PyComplex::from_doubles(py, re, im),
                "time_constant": 1.0 / re.abs(),
                "period": std::f64::consts::TAU / im.abs(),
                "what": mode.what,
                "where": mode.place,
                "end_stop": mode.stop,
            });
        }
        Ok(list)
    }

    /// Maximum stable step of each integrator, s, over all modes of the scene: at smaller steps every physically decaying mode
    /// decays.
    ///
    /// Criterion: |R(h rate)| <= 1 for the integrator's stability function R. An undamped oscillation may grow by 1 % per
    /// second, since the methods of order 1 and 2 amplify it at any step; where vehicle or joints are at speed, a lightly
    /// damped one by a tenth of its rate. Accuracy needs a step a few times smaller. A `dt` of
    /// this simulator above the stable step raises a `StepWarning`; end stops, which act only at the limits, do not count there.
    ///
    /// Parameters
    /// ----------
    /// speed, joint_servos, vehicle_servo
    ///     As for `modes`.
    /// end_stops : bool
    ///     True where joints reach their end stops.
    ///
    /// Returns
    /// -------
    /// dict
    ///     Seconds by the names of the integrators; infinite where any step is stable.
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     Speed that is negative, not finite or not a number.
    #[pyo3(
        signature = (speed=None, *, joint_servos=true, vehicle_servo=true, end_stops=true),
        text_signature = "($self, speed=None, *, joint_servos=True, vehicle_servo=True, end_stops=True)"
    )]
    fn stable_steps<'py>(
        &self,
        py: Python<'py>,
        speed: Given,
        joint_servos: bool,
        vehicle_servo: bool,
        end_stops: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let servos = Servos { joints: joint_servos, vehicle: vehicle_servo };
        let steps: Vec<_> = self.analyse(py, speed, |analysis| {
            let step = |stability| analysis.stable_step(stability, servos, end_stops).0;
            stabilities().map(|(name, stability)| (name, step(stability))).collect()
        })?;
        steps.into_py_dict(py)
    }
}

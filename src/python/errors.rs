//! Library errors as Python exceptions.

use pyo3::create_exception;
use pyo3::exceptions::{PyMemoryError, PyUserWarning, PyValueError};
use pyo3::prelude::*;

use uvms_gym::error::{
    ControlError, DescriptionError, DynamicsError, OutOfMemory, PlanningError, PolicyError, RenderError, SensorError,
    SimulatorError, TaskError,
};

create_exception!(
    uvms_gym,
    SceneError,
    PyValueError,
    "Unreadable or physically impossible scene. The message names the file, the key and the value."
);

create_exception!(
    uvms_gym,
    StepWarning,
    PyUserWarning,
    "Step too large for the scene: its result is inaccurate or not finite. The message names the rate, the mode of motion, \
     and a suitable step."
);

/// Conversion of a library error to a Python exception.
pub trait IntoPyErr {
    /// The Python exception.
    fn into_py_err(self) -> PyErr;
}

/// Conversion of a library result to a Python result.
pub trait OrRaise<T> {
    /// The value, or the exception.
    fn or_raise(self) -> PyResult<T>;
}

impl<T, E: IntoPyErr> OrRaise<T> for Result<T, E> {
    fn or_raise(self) -> PyResult<T> {
        self.map_err(IntoPyErr::into_py_err)
    }
}

impl IntoPyErr for DescriptionError {
    fn into_py_err(self) -> PyErr {
        SceneError::new_err(self.to_string())
    }
}

/// Errors that become a `ValueError`.
macro_rules! value_errors {
    ($($error:ty),*) => {$(
        impl IntoPyErr for $error {
            fn into_py_err(self) -> PyErr {
                PyValueError::new_err(self.to_string())
            }
        }
    )*};
}

value_errors!(DynamicsError, ControlError, PolicyError, RenderError, SensorError);

impl IntoPyErr for OutOfMemory {
    fn into_py_err(self) -> PyErr {
        PyMemoryError::new_err(self.to_string())
    }
}

/// Lack of memory raises a `MemoryError`, all other errors a `ValueError`.
impl IntoPyErr for SimulatorError {
    fn into_py_err(self) -> PyErr {
        match self {
            SimulatorError::OutOfMemory(error) => error.into_py_err(),
            _ => PyValueError::new_err(self.to_string()),
        }
    }
}

impl IntoPyErr for PlanningError {
    fn into_py_err(self) -> PyErr {
        match self {
            PlanningError::Simulator(error) => error.into_py_err(),
            _ => PyValueError::new_err(self.to_string()),
        }
    }
}

/// Calls out of order raise Gymnasium's `ResetNeeded`, errors of the simulator as there, all others a `ValueError`.
impl IntoPyErr for TaskError {
    fn into_py_err(self) -> PyErr {
        if let TaskError::Simulator(error) = self {
            return error.into_py_err();
        }
        if !matches!(self, TaskError::NotBegun { .. } | TaskError::Over { .. }) {
            return PyValueError::new_err(self.to_string());
        }
        Python::attach(|py| {
            let class = py.import("gymnasium.error").and_then(|module| module.getattr("ResetNeeded"));
            match class.and_then(|class| class.call1((self.to_string(),))) {
                Ok(raised) => PyErr::from_value(raised),
                Err(error) => error,
            }
        })
    }
}

//! Errors as Python exceptions.

use pyo3::create_exception;
use pyo3::exceptions::{PyUserWarning, PyValueError};
use pyo3::prelude::*;

use uvms_gym::error::{
    ControlError, DescriptionError, DynamicsError, PolicyError, RenderError, SimulatorError, TaskError,
};

create_exception!(
    uvms_gym,
    SceneError,
    PyValueError,
    "A scene that cannot be read, or that no physical system can have. The message names the file, the key and the value."
);

create_exception!(
    uvms_gym,
    StepWarning,
    PyUserWarning,
    "A step that is too large for the scene: its result is wrong, or not even finite. The message names the rate, what moves \
     that fast, and the step that suits it."
);

/// An error of the library on its way to Python.
pub trait IntoPyErr {
    /// The exception that Python users see.
    fn into_py_err(self) -> PyErr;
}

/// Results of the library as results of the Python module.
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

value_errors!(DynamicsError, ControlError, PolicyError, RenderError, SimulatorError, TaskError);

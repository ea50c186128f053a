//! Errors as Python exceptions.

use pyo3::create_exception;
use pyo3::exceptions::{PyUserWarning, PyValueError};
use pyo3::prelude::*;

use crate::error::{BalanceError, ControlError, DescriptionError, PolicyError, RenderError, SimulatorError, TaskError};

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

impl From<DescriptionError> for PyErr {
    fn from(error: DescriptionError) -> Self {
        SceneError::new_err(error.to_string())
    }
}

/// Errors that become a `ValueError`.
macro_rules! value_errors {
    ($($error:ty),*) => {$(
        impl From<$error> for PyErr {
            fn from(error: $error) -> Self {
                PyValueError::new_err(error.to_string())
            }
        }
    )*};
}

value_errors!(BalanceError, ControlError, PolicyError, RenderError, SimulatorError, TaskError);

//! Errors as Python exceptions.

use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::error::{BalanceError, ControlError, DescriptionError, SimulatorError, TaskError};

create_exception!(
    uvms_gym,
    SceneError,
    PyValueError,
    "A scene that cannot be read, or that no physical system can have. The message names the file, the key and the value."
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

value_errors!(BalanceError, ControlError, SimulatorError, TaskError);

//! The Python module `uvms_gym._core`: arguments in, arrays out, and nothing else.

mod errors;

use pyo3::prelude::*;

/// The native part of `uvms_gym`.
#[pymodule(name = "_core")]
mod core {
    #[pymodule_export]
    use super::errors::SceneError;
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}

//! The Python module `uvms_gym._core`: arguments in, arrays out, and nothing else.

mod errors;
mod station_keep;

use pyo3::prelude::*;

use crate::description::Scene;

fn scene_from(value: &Bound<'_, PyAny>) -> PyResult<Scene> {
    Ok(Scene::load(&value.extract::<String>()?)?)
}

/// The native part of `uvms_gym`.
#[pymodule(name = "_core")]
mod core {
    #[pymodule_export]
    use super::errors::SceneError;
    #[pymodule_export]
    use super::station_keep::{Pd, StationKeep};
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}

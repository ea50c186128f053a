//! `uvms_gym.integrators`.

use pyo3::prelude::*;
use pyo3::types::PyDict;

use uvms_gym::integrate::{Entry, Integrator, Kind};

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
    let entry = |entry: Entry| {
        let kind = match entry.kind {
            Kind::Production => "production",
            Kind::Baseline => "baseline",
        };
        let dict = PyDict::new(py);
        dict.set_item("name", entry.name)?;
        dict.set_item("summary", entry.summary)?;
        dict.set_item("order", entry.integrator.order())?;
        dict.set_item("kind", kind)?;
        dict.set_item("adaptive", entry.integrator.adaptive())?;
        dict.set_item("implicit", entry.integrator.implicit())?;
        Ok(dict)
    };
    Integrator::NAMES.into_iter().map(entry).collect()
}

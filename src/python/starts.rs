//! Starts of episodes from the options of `reset`.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

use super::arrays;
use super::errors::OrRaise;
use uvms_gym::task::StartOverride;
use uvms_gym::task::disturbance::Disturbance;

/// One start per instance, from arrays by name; none where nothing is given.
pub(super) fn read(given: Option<&Bound<'_, PyDict>>, n: usize, joints: usize) -> PyResult<Vec<StartOverride>> {
    let Some(given) = given.filter(|given| !given.is_empty()) else { return Ok(Vec::new()) };
    let mut starts = vec![StartOverride::default(); n];
    for (name, values) in given.iter() {
        let name: String = name.extract()?;
        if name == "disturbance" {
            set_disturbances(&mut starts, &values)?;
            continue;
        }
        let Some(width) = width(&name, joints) else {
            return Err(PyValueError::new_err(format!("unknown part of a start: '{name}'")));
        };
        let values = arrays::rows(&name, &values, n, &[width])?;
        for (i, start) in starts.iter_mut().enumerate() {
            let row = &values[i * width..(i + 1) * width];
            match name.as_str() {
                "position" => start.position = row.try_into().ok(),
                "attitude" => start.attitude = row.try_into().ok(),
                "twist" => start.twist = row.try_into().ok(),
                "q" => start.q = Some(row.to_vec()),
                "qd" => start.qd = Some(row.to_vec()),
                "target_position" => start.target_position = row.try_into().ok(),
                "target_attitude" => start.target_attitude = row.try_into().ok(),
                _ => start.current = row.try_into().ok(),
            }
        }
    }
    Ok(starts)
}

/// Number of entries of a part of a start.
fn width(name: &str, joints: usize) -> Option<usize> {
    match name {
        "position" | "target_position" | "current" => Some(3),
        "attitude" | "target_attitude" => Some(4),
        "twist" => Some(6),
        "q" | "qd" => Some(joints),
        _ => None,
    }
}

/// Sets the disturbance of every start: JSON for all, or one per instance.
fn set_disturbances(starts: &mut [StartOverride], given: &Bound<'_, PyAny>) -> PyResult<()> {
    if given.is_instance_of::<PyString>() {
        let disturbance = Disturbance::from_json(&given.extract::<String>()?).or_raise()?;
        starts.iter_mut().for_each(|start| start.disturbance = Some(disturbance.clone()));
        return Ok(());
    }
    let given: Vec<String> = given.extract()?;
    let (got, expected) = (given.len(), starts.len());
    if got != expected {
        return Err(PyValueError::new_err(format!("disturbance has {got} entries, but must have {expected}")));
    }
    for (start, json) in starts.iter_mut().zip(given) {
        start.disturbance = Some(Disturbance::from_json(&json).or_raise()?);
    }
    Ok(())
}

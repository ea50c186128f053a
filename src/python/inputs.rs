//! Inputs of a step from the keywords of a call.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString, PyTuple};

use super::arrays::{read, rows, wrong_shape};
use uvms_gym::batch::{Inputs, Simulator};

/// Maximum number of coefficients of a servo target.
const TERMS: usize = 4;

/// Keywords of a call that are not among its parameters.
pub type Keywords<'a, 'py> = &'a Bound<'py, PyDict>;

/// Inputs of a step in the order of [`Self::NAMES`], one row per instance.
#[derive(Default)]
pub struct StepInputs([Option<Vec<f64>>; 7]);

impl StepInputs {
    /// Names: the keys of `uvms_gym.StepInputs`.
    const NAMES: [&str; 7] = ["thrust", "wrench", "joint_torque", "joint_target", "external", "pose_target", "fin"];

    /// Reads all inputs among `keywords`.
    ///
    /// # Errors
    /// `TypeError` for another keyword; as [`rows`].
    pub fn read(simulator: &Simulator, keywords: Option<Keywords>) -> PyResult<Self> {
        Self::read_some(simulator, keywords, &Self::NAMES)
    }

    /// Reads inputs of a call that has only those in `allowed`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_some(simulator: &Simulator, keywords: Option<Keywords>, allowed: &[&str]) -> PyResult<Self> {
        let (instances, n) = (simulator.instances(), simulator.joints());
        let mut found = Self::default();
        for (key, given) in keywords.into_iter().flatten() {
            let name = key.cast::<PyString>()?.to_str()?;
            let known = Self::NAMES.iter().position(|known| *known == name).filter(|_| allowed.contains(&name));
            let Some(k) = known else {
                let allowed = allowed.join(", ");
                return Err(PyTypeError::new_err(format!("no input '{name}': inputs of this call are {allowed}")));
            };
            if given.is_none() {
                continue;
            }
            let rows = |row: &[usize]| rows(name, &given, instances, row);
            found.0[k] = Some(match name {
                "thrust" => rows(&[simulator.allocation().count()])?,
                "wrench" => rows(&[6])?,
                "joint_torque" => rows(&[n])?,
                "joint_target" => target(&given, instances, n)?,
                "external" => rows(&[n + 1, 6])?,
                "pose_target" => poses(name, &given, instances)?,
                _ => rows(&[simulator.scene().vehicle.fins.len()])?,
            });
        }
        Ok(found)
    }

    /// Inputs of the simulator.
    pub fn inputs(&self) -> Inputs<'_> {
        let [thrust, wrench, joint_torque, joint_target, external, pose_target, fin] =
            self.0.each_ref().map(|rows| rows.as_deref());
        Inputs { thrust, wrench, joint_torque, joint_target, external, pose_target, fin }
    }
}

/// Positions, (n,) or (N, n), or polynomials, (N, n, k).
fn target(given: &Bound<'_, PyAny>, instances: usize, n: usize) -> PyResult<Vec<f64>> {
    let (shape, numbers) = read("joint_target", given)?;
    match shape[..] {
        [joints] if joints == n => Ok(numbers.repeat(instances)),
        [all, joints] if (all, joints) == (instances, n) => Ok(numbers),
        [all, joints, terms] if (all, joints) == (instances, n) && (1..=TERMS).contains(&terms) => Ok(numbers),
        _ => {
            let all = format!("{instances}, {n}");
            let allowed = format!("({n},), ({all}) or ({all}, k) with k from 1 to {TERMS}");
            Err(wrong_shape("joint_target", &shape, &allowed))
        }
    }
}

/// A pair of position and rotation, or poses: rows of 12 numbers, position first.
pub(super) fn poses(name: &str, given: &Bound<'_, PyAny>, instances: usize) -> PyResult<Vec<f64>> {
    let Ok(pair) = given.cast::<PyTuple>() else {
        let poses = rows(name, given, instances, &[4, 4])?;
        if poses.chunks_exact(16).any(|pose| pose[12..] != [0.0, 0.0, 0.0, 1.0]) {
            return Err(PyValueError::new_err(format!("{name}: the last row of a pose must be [0, 0, 0, 1]")));
        }
        let entries = [3, 7, 11, 0, 1, 2, 4, 5, 6, 8, 9, 10];
        return Ok(poses.chunks_exact(16).flat_map(|pose| entries.map(|k| pose[k])).collect());
    };
    if pair.len() != 2 {
        let message = format!("{name} must be a pair (position, rotation), or poses (4, 4) or (N, 4, 4)");
        return Err(PyTypeError::new_err(message));
    }
    let position = rows(&format!("{name} position"), &pair.get_item(0)?, instances, &[3])?;
    let rotation = rows(&format!("{name} rotation"), &pair.get_item(1)?, instances, &[3, 3])?;
    Ok(position.chunks_exact(3).zip(rotation.chunks_exact(9)).flat_map(|(r, m)| [r, m].concat()).collect())
}

//! Inputs of a step from keyword arguments.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::arrays::{Given, optional_rows, read, rows, wrong_shape};
use uvms_gym::batch::{Inputs, Simulator};

/// Maximum number of coefficients of a servo target.
const TERMS: usize = 4;

/// Keyword arguments of a step.
#[derive(Default)]
pub struct InputArguments<'a, 'py> {
    pub thrust: Given<'a, 'py>,
    pub fin: Given<'a, 'py>,
    pub wrench: Given<'a, 'py>,
    pub joint_torque: Given<'a, 'py>,
    pub joint_target: Given<'a, 'py>,
    pub external: Given<'a, 'py>,
    pub pose_target: Given<'a, 'py>,
}

/// The same as arrays, one row per instance.
pub struct InputArrays {
    thrust: Option<Vec<f64>>,
    fin: Option<Vec<f64>>,
    wrench: Option<Vec<f64>>,
    joint_torque: Option<Vec<f64>>,
    joint_target: Option<Vec<f64>>,
    external: Option<Vec<f64>>,
    pose_target: Option<Vec<f64>>,
}

impl InputArguments<'_, '_> {
    /// Reads all of them for `simulator`.
    pub fn read(&self, simulator: &Simulator) -> PyResult<InputArrays> {
        let (instances, n) = (simulator.instances(), simulator.joints());
        let rows = |name: &str, given: Given, row: &[usize]| optional_rows(name, given, instances, row);
        Ok(InputArrays {
            thrust: rows("thrust", self.thrust, &[simulator.allocation().count()])?,
            fin: rows("fin", self.fin, &[simulator.scene().vehicle.fins.len()])?,
            wrench: rows("wrench", self.wrench, &[6])?,
            joint_torque: rows("joint_torque", self.joint_torque, &[n])?,
            joint_target: self.joint_target.map(|given| target(given, instances, n)).transpose()?,
            external: rows("external", self.external, &[n + 1, 6])?,
            pose_target: self.pose_target.map(|given| poses("pose_target", given, instances)).transpose()?,
        })
    }
}

impl InputArrays {
    /// Inputs of the simulator.
    pub fn inputs(&self) -> Inputs<'_> {
        Inputs {
            thrust: self.thrust.as_deref(),
            fin: self.fin.as_deref(),
            wrench: self.wrench.as_deref(),
            joint_torque: self.joint_torque.as_deref(),
            joint_target: self.joint_target.as_deref(),
            external: self.external.as_deref(),
            pose_target: self.pose_target.as_deref(),
        }
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

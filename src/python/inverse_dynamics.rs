//! `uvms_gym.Simulator`: inverse dynamics, trim and thruster allocation at the present states.

use nalgebra::{DVector, Vector6};
use pyo3::prelude::*;

use super::arrays::{Array, array};
use super::inputs::{Keywords, StepInputs};
use super::model::{Arrays, dict};
use super::simulator::Simulator;
use uvms_gym::dynamics::Loads;

#[pymethods]
impl Simulator {
    /// Inverse dynamics: vehicle wrench and actuator torques that give an acceleration, on top of damping, restoring, joint
    /// friction, `thrust` and `external`. [HC eq. 13]
    ///
    /// Parameters
    /// ----------
    /// acceleration : array_like (6 + n,) or (N, 6 + n)
    ///     [V'; q''], m/s2 and rad/s2.
    /// **inputs : StepInputs
    ///     thrust and external, as in `step`.
    ///
    /// Returns
    /// -------
    /// wrench : numpy.ndarray (N, 6)
    ///     Wrench on the vehicle in body axes at its origin, N and N m; supplied by the mooring of a fixed vehicle.
    /// joint_torque : numpy.ndarray (N, n)
    ///     Actuator torques, N m or N, not limited to their efforts.
    #[pyo3(signature = (acceleration, **inputs))]
    fn inverse_dynamics<'py>(
        &self,
        py: Python<'py>,
        acceleration: &Bound<'py, PyAny>,
        inputs: Option<Keywords>,
    ) -> PyResult<(Array<'py>, Array<'py>)> {
        let n = self.inner.robot_joints();
        let loads = self.loads(py, &StepInputs::read_some(&self.inner, inputs, &["thrust", "external"])?)?;
        let accelerations = self.finite_rows("acceleration", acceleration, 6 + n)?;
        let [wrench, torque] = self.each(py, [&[6], &[n]], |i, form| {
            let acceleration = DVector::from_column_slice(&accelerations[i * (6 + n)..(i + 1) * (6 + n)]);
            // Without the drives of prescribed joints, whose torques are among those in question.
            let effort = form.inverse_dynamics(&acceleration, &Loads { joint_command: &[], ..loads[i].loads() })?;
            Ok([effort.wrench.as_slice().to_vec(), effort.joint_torques.as_slice().to_vec()])
        })?;
        Ok((wrench, torque))
    }

    /// Trim: wrench, thrusts and torques that hold the system at rest at its present pose and joint coordinates, in its
    /// current.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray
    ///     wrench (N, 6): required on the vehicle, in body axes at its origin, N and N m; thrust (N, m): its allocation, N;
    ///     joint_torque (N, n): required of the actuators, N m or N, not limited to their efforts; residual (N, 6): the
    ///     part of the wrench that the thrusters cannot provide, N and N m. The mooring of a fixed vehicle provides the
    ///     wrench: its thrust and residual are 0.
    fn trim<'py>(&self, py: Python<'py>) -> Arrays<'py> {
        let simulator = &self.inner;
        let shapes: [&[usize]; 4] = [&[6], &[simulator.allocation().count()], &[simulator.robot_joints()], &[6]];
        let arrays = self.each(py, shapes, |i, _| {
            let effort = simulator.closed_form_model_of(i).trim(&simulator.state(i), simulator.flow(i))?;
            let needed = if simulator.scene().vehicle.fixed { Vector6::zeros() } else { effort.wrench };
            let allocation = simulator.allocation_of(i);
            let thrust = allocation.allocate(&needed);
            let residual = needed - allocation.wrench(&thrust);
            Ok([
                effort.wrench.as_slice().to_vec(),
                thrust[..allocation.count()].to_vec(),
                effort.joint_torques.as_slice().to_vec(),
                residual.as_slice().to_vec(),
            ])
        })?;
        dict(py, ["wrench", "thrust", "joint_torque", "residual"], arrays)
    }

    /// Allocation of a wrench on the vehicle to the thrusters by weighted least squares. If a thrust would exceed its limits,
    /// all are scaled down together: the direction of the wrench does not change.
    ///
    /// Parameters
    /// ----------
    /// wrench : array_like (6,) or (N, 6)
    ///     Wrench in body axes at the vehicle's origin, N and N m.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, m)
    ///     Thrust per thruster, N.
    fn allocate<'py>(&self, py: Python<'py>, wrench: &Bound<'py, PyAny>) -> PyResult<Array<'py>> {
        let wrenches = self.finite_rows("wrench", wrench, 6)?;
        let count = self.inner.allocation().count();
        let thrust = |(i, row)| self.inner.allocation_of(i).allocate(&Vector6::from_column_slice(row));
        let thrusts = wrenches.chunks_exact(6).enumerate().flat_map(|at| thrust(at).into_iter().take(count));
        array(py, &[self.inner.instances(), count], thrusts.collect())
    }
}

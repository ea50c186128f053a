//! `uvms_gym.Simulator`: closed form, kinematics, energy and momentum at the present states.

use nalgebra::{DMatrix, Vector6};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

use super::arrays::{Array, Given, array, rows};
use super::computation::{interruptible, shared};
use super::errors::OrRaise;
use super::inputs::InputArguments;
use super::simulator::Simulator;
use uvms_gym::batch::AppliedLoads;
use uvms_gym::dynamics::dense::Pose;
use uvms_gym::dynamics::{BodyWrenches, ClosedForm};
use uvms_gym::error::DynamicsError;

/// Arrays by name.
pub(super) type Arrays<'py> = PyResult<Bound<'py, PyDict>>;

impl Simulator {
    /// K arrays (N, ...) from rows that `f` computes per instance, on the simulator's threads; Ctrl-C interrupts.
    pub(super) fn each<'py, const K: usize>(
        &self,
        py: Python<'py>,
        shapes: [&[usize]; K],
        f: impl Fn(usize, &ClosedForm) -> Result<[Vec<f64>; K], DynamicsError> + Sync,
    ) -> PyResult<[Array<'py>; K]> {
        let (simulator, instances) = (&self.inner, self.inner.instances());
        let widths = shapes.map(|row| row.iter().product::<usize>());
        let rows = |i| Ok(simulator.closed_form(i, |form| f(i, form))?);
        let columns = interruptible(py, || simulator.each_instance(widths, rows))?.or_raise()?;
        let shapes = shapes.into_iter().map(|row| [&[instances], row].concat());
        let arrays: Vec<_> =
            shapes.zip(columns).map(|(shape, column)| array(py, &shape, column)).collect::<PyResult<_>>()?;
        Ok(arrays.try_into().expect("K shapes make K arrays"))
    }

    /// One array (N, ...).
    fn every<'py>(
        &self,
        py: Python<'py>,
        shape: &[usize],
        f: impl Fn(&ClosedForm) -> Vec<f64> + Sync,
    ) -> PyResult<Array<'py>> {
        let [array] = self.each(py, [shape], |_, form| Ok([f(form)]))?;
        Ok(array)
    }

    /// K arrays (N, ...) of one shape by name.
    fn named<'py, const K: usize>(
        &self,
        py: Python<'py>,
        names: [&str; K],
        shape: &[usize],
        f: impl Fn(usize, &ClosedForm) -> Result<[Vec<f64>; K], DynamicsError> + Sync,
    ) -> Arrays<'py> {
        dict(py, names, self.each(py, [shape; K], f)?)
    }

    /// One row of `width` finite numbers per instance.
    pub(super) fn finite_rows(&self, name: &'static str, given: &Bound<'_, PyAny>, width: usize) -> PyResult<Vec<f64>> {
        let rows = rows(name, given, self.inner.instances(), &[width])?;
        self.inner.check_rows(name, &rows, width).or_raise()?;
        Ok(rows)
    }

    pub(super) fn loads(&self, py: Python<'_>, arguments: &InputArguments) -> PyResult<Vec<AppliedLoads>> {
        let arrays = arguments.read(&self.inner)?;
        interruptible(py, || self.inner.applied_loads(&arrays.inputs()))?.or_raise()
    }
}

/// Arrays by name.
pub(super) fn dict<'py, const K: usize>(py: Python<'py>, names: [&str; K], arrays: [Array<'py>; K]) -> Arrays<'py> {
    names.into_iter().zip(arrays).into_py_dict(py)
}

/// Entries row by row.
pub(super) fn by_rows(matrix: &DMatrix<f64>) -> Vec<f64> {
    matrix.transpose().as_slice().to_vec()
}

/// A homogeneous matrix row by row.
fn pose_rows(pose: &Pose) -> Vec<f64> {
    let mut matrix = pose.rotation.to_homogeneous();
    matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&pose.position);
    matrix.transpose().as_slice().to_vec()
}

fn stacked(wrenches: &[Vector6<f64>]) -> Vec<f64> {
    wrenches.iter().flatten().copied().collect()
}

#[pymethods]
impl Simulator {
    /// Mass matrix M of W F + L tau = M [V'; q''] + C [V; q'], added mass included. [HC eqs. 13, 31, 34]
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, 6 + n, 6 + n)
    ///     Rows and columns of the body twist, about the vehicle's origin, then of the joints; kg, kg m and kg m2.
    fn mass_matrix<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        let (this, py) = (shared(slf)?, slf.py());
        let width = 6 + this.inner.joints();
        this.every(py, &[width, width], |form| by_rows(form.mass_matrix()))
    }

    /// The vector C [V; q'] of the absolute velocities: rigid bodies and added mass, current included; no damping, no
    /// restoring, no acceleration of the water. [HC eq. 13] `equations` gives Fossen's terms, damping and restoring included.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, 6 + n)
    ///     N and N m.
    fn bias<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        let (this, py) = (shared(slf)?, slf.py());
        this.every(py, &[6 + this.inner.joints()], |form| form.bias().as_slice().to_vec())
    }

    /// Influence matrix W of the wrenches on the moving bodies, six columns per body, vehicle first. [HC eq. 13]
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, 6 + n, 6 (n + 1))
    fn wrench_influence<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        let (this, py) = (shared(slf)?, slf.py());
        let n = this.inner.joints();
        this.every(py, &[6 + n, 6 * (n + 1)], |form| by_rows(&form.wrench_influence()))
    }

    /// Influence matrix L of the joint torques. [HC eq. 13]
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, 6 + n, n)
    fn torque_influence<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        let (this, py) = (shared(slf)?, slf.py());
        let n = this.inner.joints();
        this.every(py, &[6 + n, n], |form| by_rows(form.torque_influence()))
    }

    /// Wrenches on the moving bodies (vehicle first) in body axes at their frame origins, N and N m. [HC eqs. 21, 26]
    ///
    /// Arguments as in `step`. `external` in the result sums `wrench`, `external` and the wrench of the vehicle's servo.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray (N, n + 1, 6)
    ///     damping, restoring (weight and buoyancy), flow (acceleration of the water: Froude-Krylov and added mass), thrust
    ///     (thrust at this instant), fins, tether, external, and sum, the total F.
    #[pyo3(signature = (*, thrust=None, wrench=None, external=None, pose_target=None, fin=None))]
    fn body_wrenches<'py>(
        &self,
        py: Python<'py>,
        thrust: Given,
        wrench: Given,
        external: Given,
        pose_target: Given,
        fin: Given,
    ) -> Arrays<'py> {
        let loads =
            self.loads(py, &InputArguments { thrust, wrench, external, pose_target, fin, ..Default::default() })?;
        let bodies = self.inner.joints() + 1;
        let names = ["damping", "restoring", "flow", "thrust", "fins", "tether", "external", "sum"];
        self.named(py, names, &[bodies, 6], |i, form| {
            let wrenches = form.body_wrenches(&loads[i].loads())?;
            let on_vehicle = |wrench: Vector6<f64>| {
                let mut all = vec![Vector6::zeros(); bodies];
                all[0] = wrench;
                all
            };
            let [thrust, fins, tether] = [wrenches.thrust, wrenches.fins, wrenches.tether].map(on_vehicle);
            let BodyWrenches { damping, restoring, flow, external, sum, .. } = &wrenches;
            Ok([damping, restoring, flow, &thrust, &fins, &tether, external, sum].map(|w| stacked(w)))
        })
    }

    /// Torques at the joints along +q, N m or N.
    ///
    /// Arguments as in `step`; all but the first two matter to prescribed joints alone.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray (N, n)
    ///     command (actuators with their servos, limited to the effort; for a prescribed joint the torque that its motion
    ///     takes), friction, end_stop, and sum, the total tau.
    #[pyo3(signature = (
        *, joint_torque=None, joint_target=None, thrust=None, wrench=None, external=None, pose_target=None, fin=None
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn joint_torques<'py>(
        &self,
        py: Python<'py>,
        joint_torque: Given,
        joint_target: Given,
        thrust: Given,
        wrench: Given,
        external: Given,
        pose_target: Given,
        fin: Given,
    ) -> Arrays<'py> {
        let arguments = InputArguments { thrust, wrench, joint_torque, joint_target, external, pose_target, fin };
        let loads = self.loads(py, &arguments)?;
        self.named(py, ["command", "friction", "end_stop", "sum"], &[self.inner.joints()], |i, form| {
            let torques = form.joint_torques(&loads[i].loads())?;
            Ok([torques.command, torques.friction, torques.end_stop, torques.sum].map(|t| t.as_slice().to_vec()))
        })
    }

    /// Energies, J.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray (N,)
    ///     kinetic_rigid (bodies, by absolute twists, and rotors, by joint rates), kinetic_added (water set in motion, by
    ///     twists relative to it), potential (weight and buoyancy; 0 at the world origin), elastic (end stops), total.
    fn energy<'py>(slf: &Bound<'py, Self>) -> Arrays<'py> {
        let (this, py) = (shared(slf)?, slf.py());
        let names = ["kinetic_rigid", "kinetic_added", "potential", "elastic", "total"];
        this.named(py, names, &[], |_, form| {
            let e = form.energy();
            Ok([e.kinetic_rigid, e.kinetic_added, e.potential, e.elastic, e.total()].map(|x| vec![x]))
        })
    }

    /// Powers put into the system by absolute twists, W. In still water their sum is the rate of the total energy.
    ///
    /// Arguments as in `step`. `external` in the result sums `wrench`, `external` and the wrench of the vehicle's servo.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray (N,)
    ///     damping (of the bodies), friction, end_stop (damping), flow (acceleration of the water), thrust, fins, tether (its
    ///     weight included), external, joint_command, total.
    #[pyo3(signature = (
        *, thrust=None, wrench=None, joint_torque=None, joint_target=None, external=None, pose_target=None, fin=None
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn power<'py>(
        &self,
        py: Python<'py>,
        thrust: Given,
        wrench: Given,
        joint_torque: Given,
        joint_target: Given,
        external: Given,
        pose_target: Given,
        fin: Given,
    ) -> Arrays<'py> {
        let arguments = InputArguments { thrust, wrench, joint_torque, joint_target, external, pose_target, fin };
        let loads = self.loads(py, &arguments)?;
        let names = [
            "damping",
            "friction",
            "end_stop",
            "flow",
            "thrust",
            "fins",
            "tether",
            "external",
            "joint_command",
            "total",
        ];
        self.named(py, names, &[], |i, form| {
            let p = form.power(&loads[i].loads())?;
            let water = [p.damping, p.friction, p.end_stop, p.flow, p.thrust, p.fins, p.tether].map(|x| vec![x]);
            let [damping, friction, end_stop, flow, thrust, fins, tether] = water;
            let [external, command, total] = [p.external, p.joint_command, p.total()].map(|x| vec![x]);
            Ok([damping, friction, end_stop, flow, thrust, fins, tether, external, command, total])
        })
    }

    /// Total momentum [linear; angular] of the bodies and impulse of the water, in world axes about the world origin,
    /// N s and N m s.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, 6)
    fn momentum<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        let (this, py) = (shared(slf)?, slf.py());
        this.every(py, &[6], |form| form.momentum().total().as_slice().to_vec())
    }

    /// Momentum by its terms, in world axes about the world origin, N s and N m s.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray
    ///     rigid (N, 6): momentum of the bodies, by absolute twists; added (N, 6): impulse of the water, by twists relative
    ///     to it; total (N, 6): their sum; rigid_scale and total_scale (N, 2): sum over bodies of the magnitudes of their
    ///     linear and angular momentum, the scale for drifts.
    fn momentum_terms<'py>(slf: &Bound<'py, Self>) -> Arrays<'py> {
        let (this, py) = (shared(slf)?, slf.py());
        let names = ["rigid", "added", "total", "rigid_scale", "total_scale"];
        let arrays = this.each(py, [&[6], &[6], &[6], &[2], &[2]], |_, form| {
            let m = form.momentum();
            let [rigid, added, total] = [m.rigid, m.added, m.total()].map(|x| x.as_slice().to_vec());
            Ok([rigid, added, total, m.rigid_scale.to_vec(), m.total_scale.to_vec()])
        })?;
        dict(py, names, arrays)
    }

    /// Poses of the moving bodies in the world, vehicle first.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, n + 1, 4, 4)
    ///     Homogeneous matrices, body to world, m.
    fn body_poses<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        let (this, py) = (shared(slf)?, slf.py());
        this.every(py, &[this.inner.joints() + 1, 4, 4], |form| form.body_poses().iter().flat_map(pose_rows).collect())
    }

    /// Pose of the end effector in the world; of the vehicle if there is no arm.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, 4, 4)
    ///     Homogeneous matrices, end effector to world, m.
    fn end_effector_pose<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        let (this, py) = (shared(slf)?, slf.py());
        this.every(py, &[4, 4], |form| pose_rows(&form.end_effector_pose()))
    }

    /// Body Jacobian of the end effector: its absolute body twist per [V; q']. [MLS94]
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, 6, 6 + n)
    fn jacobian<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        let (this, py) = (shared(slf)?, slf.py());
        let width = 6 + this.inner.joints();
        this.every(py, &[6, width], |form| form.jacobian().transpose().as_slice().to_vec())
    }
}

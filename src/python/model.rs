//! `uvms_gym.Simulator`: closed form, kinematics, energy and momentum at the present states.

use nalgebra::{DMatrix, DVector, Vector6};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

use super::arrays::{Array, Given, array, rows};
use super::computation::{interruptible, shared};
use super::errors::OrRaise;
use super::inputs::{Keywords, StepInputs};
use super::simulator::Simulator;
use uvms_gym::batch::AppliedLoads;
use uvms_gym::dynamics::dense::DensePose;
use uvms_gym::dynamics::{BodyWrenches, ClosedForm, JointTorques};
use uvms_gym::error::DynamicsError;
use uvms_gym::terms::TERMS;

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

    /// One array (N, ...) whose rows have a shape that depends on the number of joints.
    fn every<'py, const D: usize>(
        slf: &Bound<'py, Self>,
        shape: impl FnOnce(usize) -> [usize; D],
        f: impl Fn(&ClosedForm) -> Vec<f64> + Sync,
    ) -> PyResult<Array<'py>> {
        let this = shared(slf)?;
        let [array] = this.each(slf.py(), [&shape(this.inner.robot_joints())], |_, form| Ok([f(form)]))?;
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

    /// Loads of each instance under the inputs of a call.
    pub(super) fn loads(&self, py: Python<'_>, given: &StepInputs) -> PyResult<Vec<AppliedLoads>> {
        interruptible(py, || self.inner.applied_loads(&given.inputs()))?.or_raise()
    }
}

/// Three arrays in one.
fn joined<T, const A: usize, const B: usize, const C: usize, const K: usize>(
    first: [T; A],
    second: [T; B],
    third: [T; C],
) -> [T; K] {
    const { assert!(A + B + C == K) };
    let mut entries = first.into_iter().chain(second).chain(third);
    std::array::from_fn(|_| entries.next().expect("as many entries as the sum of the lengths"))
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
pub(super) fn pose_rows(pose: &DensePose) -> Vec<f64> {
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
        Self::every(slf, |n| [6 + n, 6 + n], |form| by_rows(form.mass_matrix()))
    }

    /// The vector C [V; q'] of the absolute velocities: rigid bodies and added mass, current included; no damping, no
    /// restoring, no acceleration of the water. [HC eq. 13] `equations` gives Fossen's terms, damping and restoring included.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, 6 + n)
    ///     N and N m.
    fn bias<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::every(slf, |n| [6 + n], |form| form.bias().as_slice().to_vec())
    }

    /// Influence matrix W of the wrenches on the moving bodies, six columns per body, vehicle first. [HC eq. 13]
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, 6 + n, 6 (n + 1))
    fn wrench_influence<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::every(slf, |n| [6 + n, 6 * (n + 1)], |form| by_rows(&form.wrench_influence()))
    }

    /// Influence matrix L of the joint torques. [HC eq. 13]
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, 6 + n, n)
    fn torque_influence<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::every(slf, |n| [6 + n, n], |form| by_rows(form.torque_influence()))
    }

    /// Wrenches on the moving bodies (vehicle first) in body axes at their frame origins, N and N m. [HC eqs. 21, 26]
    ///
    /// Keywords are the inputs of `step` (StepInputs). `external` in the result sums `wrench`, `external` and the wrench of the vehicle's servo.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray (N, n + 1, 6)
    ///     damping, restoring (weight and buoyancy), flow (acceleration of the water: Froude-Krylov and added mass), thrust
    ///     (thrust at this instant), fins, tether, forward_damping, contact, external, and sum, the total F.
    #[pyo3(signature = (**inputs))]
    fn body_wrenches<'py>(&self, py: Python<'py>, inputs: Option<Keywords>) -> Arrays<'py> {
        let loads = self.loads(py, &StepInputs::read(&self.inner, inputs)?)?;
        let bodies = self.inner.robot_joints() + 1;
        const COUNT: usize = 7 + TERMS.len();
        let terms = TERMS.map(|(name, _)| name);
        let before = ["damping", "restoring", "flow", "thrust"];
        let names: [_; COUNT] = joined(before, terms, ["contact", "external", "sum"]);
        self.named(py, names, &[bodies, 6], |i, form| {
            let BodyWrenches { damping, restoring, flow, thrust, terms, contact, external, sum } =
                form.body_wrenches(&loads[i].loads())?;
            let on_vehicle = |wrench: Vector6<f64>| {
                let mut all = vec![Vector6::zeros(); bodies];
                all[0] = wrench;
                all
            };
            let wrenches: [_; COUNT] = joined(
                [damping, restoring, flow, on_vehicle(thrust)],
                terms.map(on_vehicle).into_array(),
                [contact, external, sum],
            );
            Ok(wrenches.map(|wrench| stacked(&wrench)))
        })
    }

    /// Torques at the joints along +q, N m or N.
    ///
    /// Keywords are the inputs of `step` (StepInputs). Besides joint_torque and joint_target they matter only to prescribed joints.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray (N, n)
    ///     command (actuators with their servos, limited to the effort; for a prescribed joint the torque that its motion
    ///     takes), friction, spring (springs and detents), end_stop, and sum, the total tau.
    #[pyo3(signature = (**inputs))]
    fn joint_torques<'py>(&self, py: Python<'py>, inputs: Option<Keywords>) -> Arrays<'py> {
        let loads = self.loads(py, &StepInputs::read(&self.inner, inputs)?)?;
        let names = ["command", "friction", "spring", "end_stop", "sum"];
        self.named(py, names, &[self.inner.robot_joints()], |i, form| {
            let JointTorques { command, friction, spring, end_stop, sum } = form.joint_torques(&loads[i].loads())?;
            Ok([command, friction, spring, end_stop, sum].map(|t| t.as_slice().to_vec()))
        })
    }

    /// Energies, J.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray (N,)
    ///     kinetic_rigid (bodies, by absolute twists, and rotors, by joint rates), kinetic_added (water set in motion, by
    ///     twists relative to it), potential (weight and buoyancy; 0 at the world origin), elastic (end stops, springs,
    ///     detents), contact (elastic), fixtures (all of theirs), total.
    fn energy<'py>(slf: &Bound<'py, Self>) -> Arrays<'py> {
        let (this, py) = (shared(slf)?, slf.py());
        let names = ["kinetic_rigid", "kinetic_added", "potential", "elastic", "contact", "fixtures", "total"];
        this.named(py, names, &[], |_, form| {
            let e = form.energy();
            let parts = [e.kinetic_rigid, e.kinetic_added, e.potential, e.elastic, e.contact, e.fixtures, e.total()];
            Ok(parts.map(|x| vec![x]))
        })
    }

    /// Powers put into the system by absolute twists, W. In still water their sum is the rate of the total energy.
    ///
    /// Keywords are the inputs of `step` (StepInputs). `external` in the result sums `wrench`, `external` and the wrench of the vehicle's servo.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray (N,)
    ///     damping (of the bodies), friction, end_stop (damping), flow (acceleration of the water), thrust, fins, tether (its
    ///     weight included), forward_damping, contact (dissipation and friction), fixtures (all of theirs), external,
    ///     joint_command, total.
    #[pyo3(signature = (**inputs))]
    fn power<'py>(&self, py: Python<'py>, inputs: Option<Keywords>) -> Arrays<'py> {
        let loads = self.loads(py, &StepInputs::read(&self.inner, inputs)?)?;
        const COUNT: usize = 10 + TERMS.len();
        let before = ["damping", "friction", "end_stop", "flow", "thrust"];
        let after = ["contact", "fixtures", "external", "joint_command", "total"];
        let names: [_; COUNT] = joined(before, TERMS.map(|(name, _)| name), after);
        self.named(py, names, &[], |i, form| {
            let p = form.power(&loads[i].loads())?;
            let before = [p.damping, p.friction, p.end_stop, p.flow, p.thrust];
            let after = [p.contact, p.fixtures, p.external, p.joint_command, p.total()];
            let powers: [_; COUNT] = joined(before, p.terms.into_array(), after);
            Ok(powers.map(|power| vec![power]))
        })
    }

    /// Total momentum [linear; angular] of the bodies and impulse of the water, in world axes about the world origin,
    /// N s and N m s.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, 6)
    fn momentum<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::every(slf, |_| [6], |form| form.momentum().total().as_slice().to_vec())
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
        Self::every(slf, |n| [n + 1, 4, 4], |form| form.body_poses().iter().flat_map(pose_rows).collect())
    }

    /// Pose of an end effector in the world; of the vehicle if there is no arm.
    ///
    /// Parameters
    /// ----------
    /// name : str, optional
    ///     One of `end_effector_names`; by default the end effector in use.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, 4, 4)
    ///     Homogeneous matrices, end effector to world, m.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     The scene has no end effector of this name; the message lists the names.
    #[pyo3(signature = (name=None))]
    fn end_effector_pose<'py>(&self, py: Python<'py>, name: Option<&str>) -> PyResult<Array<'py>> {
        let pose = |_, form: &ClosedForm| Ok([pose_rows(&form.pose_of(form.model.end_effector(name)?))]);
        self.each(py, [&[4, 4]], pose).map(|[array]| array)
    }

    /// Body Jacobian of an end effector: its absolute body twist per [V; q']. [MLS94]
    ///
    /// Parameters
    /// ----------
    /// name : str, optional
    ///     One of `end_effector_names`; by default the end effector in use.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, 6, 6 + n)
    ///     Rows are [v; omega] in the axes of the end effector.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     The scene has no end effector of this name; the message lists the names.
    #[pyo3(signature = (name=None))]
    fn jacobian<'py>(&self, py: Python<'py>, name: Option<&str>) -> PyResult<Array<'py>> {
        let rows = |_, form: &ClosedForm| {
            Ok([form.jacobian_of(form.model.end_effector(name)?).transpose().as_slice().to_vec()])
        };
        self.each(py, [&[6, 6 + self.inner.robot_joints()]], rows).map(|[array]| array)
    }

    /// Equations of motion in Fossen's form, `M nu' + C(nu) nu + D(nu) nu + g(eta) = tau`. [F21 sections 6.3, 10.3]
    ///
    /// nu = [V_r; q'] is the body twist relative to the water, V_r = V - [R^T v_c; 0], and the joint rates. The
    /// equations hold with nu' = [V_r'; q''] and V_r' = V' + [omega x R^T v_c - R^T a_c; 0], where V' and q'' are those of
    /// `forward_dynamics`; in still water nu = [V; q']. Rows are the wrench on the vehicle at its origin and the joints.
    ///
    /// tau is everything else, tau = W (thrust + fins + tether + external) + L command, with W and L of
    /// `wrench_influence` and `torque_influence`, the wrenches of `body_wrenches` and the torques of `joint_torques`. The
    /// first six rows of a fixed vehicle hold with the wrench of its mooring in tau.
    ///
    /// Parameters
    /// ----------
    /// nu : array_like (6 + n,) or (N, 6 + n), optional
    ///     Velocity [V_r; q'] in place of the present one, m/s and rad/s, in `axes`.
    /// axes : {"flu", "ned"}
    ///     Body axes of the vehicle: x forward, y left, z up; or Fossen's, x forward, y starboard, z down, which give
    ///     S M S and S x with S = diag(1, -1, -1, 1, -1, -1) on the vehicle's rows and columns.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray
    ///     nu (N, 6 + n): the velocity, m/s and rad/s; M (N, 6 + n, 6 + n): rigid and added mass, kg, kg m and kg m2;
    ///     C_nu (N, 6 + n): the product C(nu) nu, N and N m, Munk moment included; D_nu (N, 6 + n): the product D(nu) nu of
    ///     linear and quadratic damping, joint friction and damping of end stops, against the motion: 0 at nu = 0;
    ///     g (N, 6 + n): minus the force of weight, buoyancy and elastic end stops, the gradient of the potential energy;
    ///     with gravity less a_c where the water accelerates by a_c.
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     `nu` has the wrong shape or type, or is not finite; `axes` is neither "flu" nor "ned".
    #[pyo3(signature = (nu=None, *, axes="flu"))]
    fn equations<'py>(&self, py: Python<'py>, nu: Given, axes: &str) -> PyResult<Bound<'py, PyDict>> {
        let ned = match axes {
            "flu" => false,
            "ned" => true,
            _ => return Err(PyValueError::new_err(format!("axes is {axes:?}, but must be \"flu\" or \"ned\""))),
        };
        let width = 6 + self.inner.robot_joints();
        let mut given = nu.map(|nu| self.finite_rows("nu", nu, width)).transpose()?;
        if let (Some(given), true) = (&mut given, ned) {
            given.chunks_exact_mut(width).for_each(|row| [1, 2, 4, 5].into_iter().for_each(|k| row[k] = -row[k]));
        }
        let shapes: [&[usize]; 5] = [&[width], &[width, width], &[width], &[width], &[width]];
        let arrays = self.each(py, shapes, |i, form| {
            let nu = given.as_ref().map(|rows| DVector::from_column_slice(&rows[i * width..(i + 1) * width]));
            let form = form.fossen_form(nu.as_ref())?;
            let form = if ned { form.in_ned_axes() } else { form };
            let [nu, coriolis, damping, restoring] =
                [form.velocity, form.coriolis, form.damping, form.restoring].map(|x| x.as_slice().to_vec());
            Ok([nu, by_rows(&form.mass_matrix), coriolis, damping, restoring])
        })?;
        dict(py, ["nu", "M", "C_nu", "D_nu", "g"], arrays)
    }
}

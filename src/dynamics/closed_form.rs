//! Closed form of a scene at a state: M, C [V; q'], W, L, the wrenches and torques that enter it, and its solution.

use nalgebra::{Cholesky, DMatrix, DVector, Vector3, Vector6};

use super::closed_form_model::ClosedFormModel;
use super::dense::{DensePose, EndStop, friction, relative_twist, spring};
use super::dynamical_balance::Equations;
use crate::error::DynamicsError;
use crate::system::Flow;
use crate::terms::{DenseInstant, PerTerm};

/// Applied thrusts, wrenches, torques and fin deflections; an empty slice stands for zeros.
#[derive(Debug, Clone, Copy, Default)]
pub struct Loads<'a> {
    /// Thrust per thruster, N, within its limits.
    pub thrust: &'a [f64],
    /// Wrench per moving body (vehicle first) at its frame origin, body axes, N and N m.
    pub external: &'a [Vector6<f64>],
    /// Actuator torque per joint, N m or N, within its effort; of a prescribed joint, [`ClosedForm::drive_torques`].
    pub joint_command: &'a [f64],
    /// Acceleration of the prescribed joints, one entry per joint, rad/s2 or m/s2; entries of other joints are not read.
    pub joint_acceleration: &'a [f64],
    /// Deflection per fin, rad; an empty slice stands for the scene's deflections.
    pub fins: &'a [f64],
}

/// Wrenches on the moving bodies (vehicle first), body axes at their frame origins, N and N m. `[HC eqs. 21, 26]`
#[derive(Debug, Clone, PartialEq)]
pub struct BodyWrenches {
    /// Linear and quadratic damping.
    pub damping: Vec<Vector6<f64>>,
    /// Weight and buoyancy.
    pub restoring: Vec<Vector6<f64>>,
    /// Acceleration of the water: Froude-Krylov force and added mass.
    pub flow: Vec<Vector6<f64>>,
    /// Thrusters, on the vehicle.
    pub thrust: Vector6<f64>,
    /// Terms of the vehicle: fins, tether and others.
    pub terms: PerTerm<Vector6<f64>>,
    /// Contacts.
    pub contact: Vec<Vector6<f64>>,
    /// External wrenches.
    pub external: Vec<Vector6<f64>>,
    /// Sum of all the above.
    pub sum: Vec<Vector6<f64>>,
}

/// Torques on the joints, N m or N, (n) each.
#[derive(Debug, Clone, PartialEq)]
pub struct JointTorques {
    /// Viscous, Coulomb and static friction.
    pub friction: DVector<f64>,
    /// Springs and detents.
    pub spring: DVector<f64>,
    /// End stops, elastic and damping.
    pub end_stop: DVector<f64>,
    /// Actuators.
    pub command: DVector<f64>,
    /// Sum of all the above.
    pub sum: DVector<f64>,
}

/// Residual of the equations of motion at an acceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// `|M a + c - f|`.
    pub norm: f64,
    /// `|M| |a| + |c| + |f|`, Frobenius and Euclidean norms.
    pub scale: f64,
}

/// `W F + L tau = M [V'; q''] + C [V; q']` of a scene at a state. `[HC eqs. 13, 31, 34]`
///
/// `equations` holds M, C, W and L, with columns of W for every body, those fixed to another one included.
#[derive(Debug, Clone)]
pub struct ClosedForm<'a> {
    /// Composed model of the scene.
    pub model: &'a ClosedFormModel,
    pub(super) equations: Equations<'a>,
    /// Indices of the moving bodies in `equations`: the vehicle, and one per joint.
    pub(super) moving: Vec<usize>,
    /// Pose of the vehicle in the world.
    pub(super) pose: DensePose,
    pub(super) q: DVector<f64>,
    pub(super) qd: DVector<f64>,
    pub(super) flow: Flow,
    /// The fixtures, each as an arm on a fixed vehicle.
    pub(super) fixtures: Vec<ClosedForm<'a>>,
}

impl ClosedForm<'_> {
    /// Number of joints n.
    pub fn joints(&self) -> usize {
        self.q.len()
    }

    /// M, (6+n, 6+n), added mass included.
    pub fn mass_matrix(&self) -> &DMatrix<f64> {
        &self.equations.mass_matrix
    }

    /// The product `C [V; q']`, (6+n): rigid and added mass, current included; no damping, no restoring, no acceleration of
    /// the water.
    pub fn bias(&self) -> &DVector<f64> {
        &self.equations.bias
    }

    /// W, (6+n, 6(n+1)): six columns per moving body, vehicle first.
    pub fn wrench_influence(&self) -> DMatrix<f64> {
        let columns: Vec<usize> = self.moving.iter().flat_map(|k| 6 * k..6 * k + 6).collect();
        self.equations.wrench_influence.select_columns(&columns)
    }

    /// L, (6+n, n).
    pub fn torque_influence(&self) -> &DMatrix<f64> {
        &self.equations.torque_influence
    }

    /// Wrenches on the moving bodies.
    ///
    /// # Errors
    /// [`DynamicsError::Length`] for a nonempty `thrust`, `fins` or `external` whose length does not match the scene.
    pub fn body_wrenches(&self, loads: &Loads) -> Result<BodyWrenches, DynamicsError> {
        let thrusters = self.model.thruster_configuration.ncols();
        let thrust = DVector::from_vec(filled("thrust", loads.thrust, thrusters, 0.0)?);
        let external = filled("external wrench", loads.external, self.moving.len(), Vector6::zeros())?;
        let (damping, restoring, flow) = (self.damping(), self.restoring(), self.flow_acceleration());
        let thrust = Vector6::from_column_slice((&self.model.thruster_configuration * thrust).as_slice());
        let contact = self.contact_wrenches();
        let sum = |k: usize| damping[k] + restoring[k] + flow[k] + contact[k] + external[k];
        let mut sum: Vec<_> = (0..damping.len()).map(sum).collect();
        sum[0] += thrust;
        let deflections = match loads.fins {
            [] => self.model.vehicle.deflections(),
            given => filled("fin deflection", given, self.model.vehicle.fins.len(), 0.0)?,
        };
        let terms = self.term_wrenches(&deflections);
        sum[0] += terms.into_array().iter().sum::<Vector6<f64>>();
        Ok(BodyWrenches { damping, restoring, flow, thrust, terms, contact, external, sum })
    }

    /// Wrenches of the vehicle's terms at deflections of the fins, N and N m.
    pub(super) fn term_wrenches(&self, deflections: &[f64]) -> PerTerm<Vector6<f64>> {
        let gravity = self.pose.rotation.tr_mul(&self.model.gravity);
        let (density, relative) = (self.model.density, self.relative_twist(0));
        self.model.vehicle.dense_term_wrenches(&DenseInstant { density, gravity, relative, deflections })
    }

    /// Damping wrench per moving body, N and N m. `[HC eq. 22]`
    pub fn damping(&self) -> Vec<Vector6<f64>> {
        self.merged(|k| {
            let motion = &self.equations.bodies[k];
            motion.body.damping(&self.relative_twist(k))
        })
    }

    /// Weight and buoyancy per moving body. `[HC eq. 24]`
    pub fn restoring(&self) -> Vec<Vector6<f64>> {
        self.restoring_in(&self.model.gravity)
    }

    /// Weight and buoyancy per moving body under `gravity` (world axes, m/s2).
    pub(super) fn restoring_in(&self, gravity: &Vector3<f64>) -> Vec<Vector6<f64>> {
        self.merged(|k| {
            let rotation = self.world_pose(k).rotation;
            self.equations.bodies[k].body.restoring(&rotation.tr_mul(gravity))
        })
    }

    /// Viscous, Coulomb and static friction of the joints, (n), N m or N.
    pub(super) fn friction(&self) -> DVector<f64> {
        DVector::from_fn(self.joints(), |i, _| friction(self.equations.joints[i], self.qd[i]))
    }

    /// Torques of the joints' springs and detents, N m or N, and their energies, J.
    pub(super) fn springs(&self) -> impl Iterator<Item = (f64, f64)> {
        self.equations.joints.iter().enumerate().map(|(i, joint)| spring(joint, self.q[i]))
    }

    pub(super) fn end_stops(&self) -> impl Iterator<Item = EndStop> {
        self.equations.joints.iter().enumerate().map(|(i, joint)| EndStop::new(joint, self.q[i], self.qd[i]))
    }

    /// Wrench of the water's acceleration a_c per moving body: pressure gradient (Froude-Krylov) and added mass, whose V_r'
    /// contains `-[R^T a_c; 0]`.
    pub fn flow_acceleration(&self) -> Vec<Vector6<f64>> {
        self.merged(|k| {
            let rotation = self.world_pose(k).rotation;
            self.equations.bodies[k].body.flow_acceleration(&rotation.tr_mul(&self.flow.acceleration))
        })
    }

    /// Torques on the joints.
    ///
    /// # Errors
    /// [`DynamicsError::Length`] for a nonempty `joint_command` whose length does not match the scene.
    pub fn joint_torques(&self, loads: &Loads) -> Result<JointTorques, DynamicsError> {
        let n = self.joints();
        let command = DVector::from_vec(filled("joint command", loads.joint_command, n, 0.0)?);
        let friction = self.friction();
        let end_stop = DVector::from_iterator(n, self.end_stops().map(|stop| stop.elastic + stop.damping));
        let spring = DVector::from_iterator(n, self.springs().map(|(torque, _)| torque));
        let sum = &friction + &end_stop + &command + &spring;
        Ok(JointTorques { friction, spring, end_stop, command, sum })
    }

    /// `W F + L tau`, (6+n).
    ///
    /// # Errors
    /// [`DynamicsError::Length`] for a nonempty load whose length does not match the scene.
    pub fn generalized_force(&self, loads: &Loads) -> Result<DVector<f64>, DynamicsError> {
        let wrenches = self.body_wrenches(loads)?.sum;
        let stacked = DVector::from_iterator(6 * wrenches.len(), wrenches.iter().flatten().copied());
        Ok(self.wrench_influence() * stacked + self.torque_influence() * self.joint_torques(loads)?.sum)
    }

    /// Forward dynamics by Cholesky factorisation of M: `[V'; q'']`, (6+n), with V' = 0 for a fixed vehicle and given q'' of
    /// prescribed joints: hybrid dynamics `M_ff a_f = (W F + L tau - C [V; q'] - M a_p)_f` of the free rows f. `[RF08 sec. 9.2]`
    ///
    /// # Errors
    /// [`DynamicsError::NotPositiveDefinite`] for an M without Cholesky factorisation, [`DynamicsError::Length`] as in
    /// [`Self::generalized_force`], or for a nonempty `joint_acceleration` whose length does not match the scene.
    pub fn accelerations(&self, loads: &Loads) -> Result<DVector<f64>, DynamicsError> {
        let given = filled("joint acceleration", loads.joint_acceleration, self.joints(), 0.0)?;
        let mut accelerations = DVector::zeros(self.bias().len());
        let mut free: Vec<usize> = (self.first_free_row()..6).collect();
        for (k, joint) in self.equations.joints.iter().enumerate() {
            if joint.prescribed {
                accelerations[6 + k] = given[k];
            } else {
                free.push(6 + k);
            }
        }
        let net = self.generalized_force(loads)? - self.bias() - self.mass_matrix() * &accelerations;
        let mass = self.mass_matrix().select_columns(&free).select_rows(&free);
        let factor = Cholesky::new(mass).ok_or(DynamicsError::NotPositiveDefinite)?;
        for (&row, value) in free.iter().zip(&factor.solve(&net.select_rows(&free))) {
            accelerations[row] = *value;
        }
        Ok(accelerations)
    }

    /// Torques of the drives of prescribed joints, N m or N, (n): those that, with friction, springs, detents and end
    /// stops, give the joints their accelerations. Of other joints, their entry of `joint_command`.
    ///
    /// # Errors
    /// As [`Self::accelerations`].
    pub fn drive_torques(&self, loads: &Loads) -> Result<DVector<f64>, DynamicsError> {
        let missing = self.inverse_dynamics(&self.accelerations(loads)?, loads)?.joint_torques;
        let command = filled("joint command", loads.joint_command, self.joints(), 0.0)?;
        let prescribed = |k: usize| if self.equations.joints[k].prescribed { missing[k] } else { 0.0 };
        Ok(DVector::from_fn(self.joints(), |k, _| command[k] + prescribed(k)))
    }

    /// Residual of the equations of motion at `accelerations`, (6+n); of the joints' rows only for a fixed vehicle.
    ///
    /// # Errors
    /// [`DynamicsError::Length`] as in [`Self::generalized_force`], or for `accelerations` of another length than 6+n.
    pub fn residual(&self, accelerations: &DVector<f64>, loads: &Loads) -> Result<Residual, DynamicsError> {
        self.check_size("acceleration", accelerations)?;
        let first = self.first_free_row();
        let force = self.generalized_force(loads)?;
        let tail = |v: &DVector<f64>| v.rows(first, v.len() - first).into_owned();
        let (a, c, f) = (tail(accelerations), tail(self.bias()), tail(&force));
        let mass = self.mass_matrix().view((first, first), (a.len(), a.len()));
        Ok(Residual { norm: (mass * &a + &c - &f).norm(), scale: mass.norm() * a.norm() + c.norm() + f.norm() })
    }

    pub(super) fn check_size(&self, what: &'static str, vector: &DVector<f64>) -> Result<(), DynamicsError> {
        let expected = self.bias().len();
        if vector.len() == expected { Ok(()) } else { Err(DynamicsError::Length { what, expected, got: vector.len() }) }
    }

    fn first_free_row(&self) -> usize {
        if self.model.fixed { 6 } else { 0 }
    }

    /// Pose of body `k` of `equations` in the world.
    pub(super) fn world_pose(&self, k: usize) -> DensePose {
        self.pose * self.equations.bodies[k].pose
    }

    /// V_r of body `k` of `equations`. `[HC eq. 23]`
    pub(super) fn relative_twist(&self, k: usize) -> Vector6<f64> {
        let water = self.world_pose(k).rotation.tr_mul(&self.flow.velocity);
        relative_twist(&self.equations.bodies[k].twist, &water)
    }

    /// Wrenches of all bodies of `equations`, summed per moving body in its frame.
    fn merged(&self, wrench: impl Fn(usize) -> Vector6<f64>) -> Vec<Vector6<f64>> {
        let mut per_body = vec![Vector6::zeros(); self.equations.bodies.len()];
        for (k, motion) in self.equations.bodies.iter().enumerate() {
            per_body[motion.carrier] += motion.in_carrier.wrench_to_parent(&wrench(k));
        }
        self.moving.iter().map(|&k| per_body[k]).collect()
    }
}

/// `given`, or zeros if it is empty.
fn filled<T: Clone>(what: &'static str, given: &[T], expected: usize, zero: T) -> Result<Vec<T>, DynamicsError> {
    match given.len() {
        0 => Ok(vec![zero; expected]),
        got if got == expected => Ok(given.to_vec()),
        got => Err(DynamicsError::Length { what, expected, got }),
    }
}

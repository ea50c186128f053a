//! Inputs of a call, their check, and the loads of an instance that they give.

use nalgebra as na;

use super::own_scenes::OwnScenes;
use crate::batch::options::SimulatorOptions;
use crate::control::{Allocation, THRUSTERS, Thrusts};
use crate::description::{Fin, Scene};
use crate::error::SimulatorError;
use crate::system::JOINTS;
use crate::terms::FINS;

/// Maximum entry of `R^T R - I` of an accepted rotation.
const ORTHONORMAL: f64 = 1e-6;

/// Loads on all instances over one call, row-major by instance; an absent one is zero.
#[derive(Debug, Clone, Copy, Default)]
pub struct Inputs<'a> {
    /// Thrust, (N, thrusters), N; saturates at each thruster's limits. A command where thrusters have dynamics.
    pub thrust: Option<&'a [f64]>,
    /// Deflections, (N, fins), rad, limited to each fin's range; the scene's deflections where absent.
    pub fin: Option<&'a [f64]>,
    /// Wrench on the vehicle, (N, 6), body frame at its origin, N and N m; on top of the thrust.
    pub wrench: Option<&'a [f64]>,
    /// Actuator torques, (N, n), N m or N; their sum with the servo's saturates at each joint's effort.
    pub joint_torque: Option<&'a [f64]>,
    /// Servo targets, (N, n, k) with k <= 4: polynomials in the time since the call, constant term first, rad or m.
    /// Servos are on where targets are given. Prescribed joints follow them exactly; without targets their rates stay constant.
    pub joint_target: Option<&'a [f64]>,
    /// External wrenches, (N, n + 1, 6), vehicle first, each in its body's frame at its origin, N and N m.
    pub external: Option<&'a [f64]>,
    /// Target pose of the vehicle servo, (N, 12): position, then rotation by rows. The servo is on where it is given.
    pub pose_target: Option<&'a [f64]>,
}

/// Optional loads that are active, the same for all instances.
#[derive(Debug, Clone, Copy, Default)]
pub struct ActiveLoads {
    /// Coefficients of each joint servo's target; 0 where these servos are off.
    pub target_terms: usize,
    /// External wrenches on links.
    pub link_wrenches: bool,
    /// True where the vehicle's servo holds a pose, evaluated at every stage.
    pub station: bool,
}

/// Loads on one instance, held until they are set again.
#[derive(Debug, Clone, PartialEq)]
pub struct InstanceLoads {
    /// Wrench on the vehicle in its body frame, at the frame's origin, N and N m.
    pub wrench: [f64; 6],
    /// Commanded thrusts, N, where thrusters have dynamics; without dynamics their wrench is part of `wrench`.
    pub command: Thrusts,
    /// Deflections of the fins, rad.
    pub fins: [f64; FINS],
    /// Actuator torques, N m or N.
    pub torque: [f64; JOINTS],
    /// Servo targets: polynomials in the time since the step's call, constant term first, rad or m.
    pub target: [[f64; 4]; JOINTS],
    /// External wrenches on the links, each in its link frame, N and N m.
    pub links: [[f64; 6]; JOINTS],
    /// Target of the vehicle's servo: rotation and position, m.
    pub station: (na::Matrix3<f64>, na::Vector3<f64>),
}

impl Default for InstanceLoads {
    fn default() -> Self {
        Self {
            wrench: [0.0; 6],
            command: [0.0; THRUSTERS],
            fins: [0.0; FINS],
            torque: [0.0; JOINTS],
            target: [[0.0; 4]; JOINTS],
            links: [[0.0; 6]; JOINTS],
            station: (na::Matrix3::identity(), na::Vector3::zeros()),
        }
    }
}

/// Checks that there are `width` finite numbers per instance.
pub fn check(
    name: &'static str,
    values: Option<&[f64]>,
    width: usize,
    options: &SimulatorOptions,
) -> Result<(), SimulatorError> {
    let Some(values) = values else { return Ok(()) };
    let expected = options.instances * width;
    if values.len() != expected {
        return Err(SimulatorError::Length { name, expected, got: values.len() });
    }
    if options.precision.all_finite(values) {
        return Ok(());
    }
    match values.iter().position(|x| !options.precision.is_finite(*x)) {
        Some(at) => Err(SimulatorError::NotFinite { name, instance: at / width, entry: at % width, value: values[at] }),
        None => Ok(()),
    }
}

/// Checks a rotation matrix to within [`ORTHONORMAL`]; its deviation.
pub fn check_rotation(name: &'static str, instance: usize, rotation: &na::Matrix3<f64>) -> Result<f64, SimulatorError> {
    let deviation = (rotation.tr_mul(rotation) - na::Matrix3::identity()).amax();
    let determinant = rotation.determinant();
    if deviation <= ORTHONORMAL && determinant > 0.0 {
        Ok(deviation)
    } else {
        Err(SimulatorError::NotARotation { name, instance, deviation, determinant })
    }
}

/// Checked inputs of one call.
pub struct CheckedInputs<'a> {
    /// Inputs of all instances.
    pub inputs: Inputs<'a>,
    /// The scene's thruster allocation.
    pub allocation: &'a Allocation,
    joints: usize,
    /// Coefficients of each servo target.
    pub terms: usize,
    /// True where thrusts are commands to thrusters with dynamics.
    commands: bool,
    /// The scene's fins.
    pub fins: &'a [Fin],
    /// Scenes of the instances, where their thrusters or fins differ.
    own: Option<&'a OwnScenes>,
}

impl<'a> CheckedInputs<'a> {
    /// Checks lengths, finiteness, rotations, and that the servos asked for exist.
    ///
    /// # Errors
    /// [`SimulatorError`] that names the input.
    pub fn new(
        inputs: &Inputs<'a>,
        scene: &'a Scene,
        allocation: &'a Allocation,
        own: Option<&'a OwnScenes>,
        options: &SimulatorOptions,
    ) -> Result<Self, SimulatorError> {
        if inputs.pose_target.is_some() && scene.vehicle.servo.is_none() {
            return Err(SimulatorError::NoVehicleServo { scene: scene.name.clone() });
        }
        if inputs.joint_target.is_some_and(|t| !t.is_empty())
            && scene.coordinates().all(|joint| joint.servo.is_none() && !joint.prescribed)
        {
            return Err(SimulatorError::NoJointServo { scene: scene.name.clone() });
        }
        let joints = scene.coordinates().count();
        let terms = inputs.joint_target.map_or(0, |t| t.len() / (options.instances * joints).max(1));
        let expected = [
            ("thrust", inputs.thrust, allocation.count()),
            ("fin", inputs.fin, scene.vehicle.fins.len()),
            ("wrench", inputs.wrench, 6),
            ("joint_torque", inputs.joint_torque, joints),
            ("joint_target", inputs.joint_target, joints * terms.clamp(1, 4)),
            ("external", inputs.external, 6 * (joints + 1)),
            ("pose_target", inputs.pose_target, 12),
        ];
        for (name, values, width) in expected {
            check(name, values, width, options)?;
        }
        for (i, station) in inputs.pose_target.iter().flat_map(|s| s.chunks_exact(12)).enumerate() {
            check_rotation("pose_target", i, &na::Matrix3::from_row_slice(&station[3..]))?;
        }
        Ok(Self {
            inputs: *inputs,
            allocation,
            joints,
            terms,
            commands: scene.vehicle.has_thruster_dynamics(),
            fins: &scene.vehicle.fins,
            own: own.filter(|own| own.own_actuators),
        })
    }

    /// Optional loads that are active.
    pub fn active_loads(&self) -> ActiveLoads {
        ActiveLoads {
            target_terms: self.terms,
            link_wrenches: self.inputs.external.is_some(),
            station: self.inputs.pose_target.is_some(),
        }
    }

    /// True where thrusters or fins differ between instances.
    pub fn own_actuators(&self) -> bool {
        self.own.is_some()
    }

    /// Thruster allocation of instance `i`.
    pub fn allocation_of(&self, i: usize) -> &'a Allocation {
        self.own.map_or(self.allocation, |own| own.allocation(i))
    }

    /// Fins of instance `i`.
    pub fn fins_of(&self, i: usize) -> &'a [Fin] {
        self.own.map_or(self.fins, |own| &own.scenes()[i].vehicle.fins)
    }

    /// Thrust of instance `i` within limits, times a factor.
    pub fn thrust(&self, i: usize, factor: f64) -> Thrusts {
        let m = self.allocation.count();
        let allocation = self.allocation_of(i);
        let mut thrusts = [0.0; THRUSTERS];
        if let Some(given) = self.inputs.thrust {
            for k in 0..m {
                let [low, high] = allocation.limits(k);
                thrusts[k] = factor * given[i * m + k].clamp(low, high);
            }
        }
        thrusts
    }

    /// Wrench on the vehicle of instance `i` without the wrench of its thrusters.
    pub fn wrench(&self, i: usize) -> [f64; 6] {
        let external = self.row(self.inputs.external, 6 * (self.joints + 1), i);
        let terms = [self.row(self.inputs.wrench, 6, i), external.map(|e| &e[..6])];
        terms.into_iter().flatten().fold([0.0; 6], |sum, term| std::array::from_fn(|k| sum[k] + term[k]))
    }

    fn row(&self, values: Option<&'a [f64]>, width: usize, i: usize) -> Option<&'a [f64]> {
        values.map(|v| &v[i * width..(i + 1) * width])
    }

    /// Wrenches on the links of instance `i`.
    pub fn links(&self, i: usize) -> impl Iterator<Item = [f64; 6]> + 'a {
        let external = self.row(self.inputs.external, 6 * (self.joints + 1), i).unwrap_or_default();
        external.as_chunks().0.iter().skip(1).copied()
    }

    /// Loads of instance `i` with a factor `thrust` on its thrusts.
    pub fn loads(&self, i: usize, thrust: f64) -> InstanceLoads {
        let (n, inputs, mut loads) = (self.joints, &self.inputs, InstanceLoads::default());
        if self.commands {
            loads.command = self.thrust(i, 1.0);
        } else if inputs.thrust.is_some() {
            loads.wrench = self.allocation_of(i).wrench(&self.thrust(i, thrust)).into();
        }
        for (sum, extra) in loads.wrench.iter_mut().zip(self.wrench(i)) {
            *sum += extra;
        }
        for (k, fin) in self.fins_of(i).iter().enumerate() {
            let [lower, upper] = fin.range();
            let given = self.row(inputs.fin, self.fins.len(), i);
            loads.fins[k] = given.map_or(fin.deflection, |given| given[k].clamp(lower, upper));
        }
        for (to, wrench) in loads.links.iter_mut().zip(self.links(i)) {
            *to = wrench;
        }
        for k in 0..n {
            loads.torque[k] = self.row(inputs.joint_torque, n, i).map_or(0.0, |t| t[k]);
            if let Some(target) = self.row(inputs.joint_target, n * self.terms, i) {
                loads.target[k][..self.terms].copy_from_slice(&target[k * self.terms..(k + 1) * self.terms]);
            }
        }
        if let Some(station) = self.row(inputs.pose_target, 12, i) {
            loads.station.1 = na::Vector3::from_column_slice(&station[..3]);
            loads.station.0 = na::Matrix3::from_row_slice(&station[3..]);
        }
        loads
    }
}

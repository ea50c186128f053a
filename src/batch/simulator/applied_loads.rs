//! Applied loads: the loads of the closed form that inputs cause at the present states.

use nalgebra as na;
use nalgebra::Vector6;

use super::Simulator;
use crate::batch::stepping::equations_of_motion::StationServo;
use crate::batch::storage::inputs::{CheckedInputs, Inputs, InstanceLoads};
use crate::description::Joint;
use crate::dynamics::Loads;
use crate::dynamics::dense::actuator_torque;
use crate::dynamics::place::Place;
use crate::error::SimulatorError;
use crate::hydro::{ThrusterDynamics, Thrusts};
use crate::lie::{self, Matrix3, Pose, Vector3};
use crate::limits::interrupt;
use crate::system::{Compiled, State};

/// Loads on one instance.
#[derive(Debug, Clone, PartialEq)]
pub struct AppliedLoads {
    /// Thrust per thruster, N, within its limits; the present thrust where thrusters have dynamics.
    pub thrust: Vec<f64>,
    /// Wrench per moving body, vehicle first, the vehicle's servo included, N and N m.
    pub external: Vec<Vector6<f64>>,
    /// Deflection per fin, rad.
    pub fins: Vec<f64>,
    /// Torque of each joint's actuator, its servo included, within its effort, N m or N; for a prescribed joint the torque of
    /// its drive.
    pub joint_command: Vec<f64>,
    /// Acceleration of each prescribed joint, rad/s2 or m/s2; 0 for other joints.
    pub joint_acceleration: Vec<f64>,
}

impl AppliedLoads {
    /// In the form of the closed form.
    pub fn loads(&self) -> Loads<'_> {
        Loads {
            thrust: &self.thrust,
            external: &self.external,
            joint_command: &self.joint_command,
            joint_acceleration: &self.joint_acceleration,
            fins: &self.fins,
        }
    }
}

impl Simulator {
    /// Loads that `inputs` put on every instance at its state, at the start of a step.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn applied_loads(&self, inputs: &Inputs) -> Result<Vec<AppliedLoads>, SimulatorError> {
        let inputs = CheckedInputs::new(inputs, self.scene(), self.allocation(), self.own.as_ref(), self.options())?;
        let prescribed = self.compiled().system.prescribed;
        let loads = (0..self.instances()).map(|i| {
            if interrupt::requested() {
                return Err(SimulatorError::Interrupted);
            }
            let mut loads = self.loads_of(&inputs, i);
            if prescribed {
                let torques = self.closed_form(i, |form| form.drive_torques(&loads.loads()))?;
                loads.joint_command = torques.as_slice().to_vec();
            }
            Ok(loads)
        });
        loads.collect()
    }

    fn loads_of(&self, inputs: &CheckedInputs, i: usize) -> AppliedLoads {
        let (state, active, compiled) = (self.state(i), inputs.active_loads(), self.compiled_of(i));
        let thrust = self.factors(i).thrust;
        let given = inputs.loads(i, thrust);
        let mut vehicle = Vector6::from(inputs.wrench(i));
        if active.station {
            vehicle += station_wrench(&compiled, &state, &given);
        }
        let links = given.links[..self.robot_joints()].iter().map(|&wrench| wrench.into());
        let torque = |(k, joint): (usize, &Joint)| {
            if joint.prescribed {
                return 0.0;
            }
            let target = (active.target_terms > 0).then(|| (given.target[k][0], given.target[k][1]));
            actuator_torque(joint, state.q[k], state.qd[k], given.torque[k], target)
        };
        let acceleration = |(joint, target): (&Joint, &[f64; 4])| if joint.prescribed { 2.0 * target[2] } else { 0.0 };
        let thrust = match self.propulsion(i, &given.command) {
            Some(propulsion) => propulsion.acting(&compiled.system.thrusters, self.twist_through_water(i)),
            None => inputs.thrust(i, thrust),
        };
        AppliedLoads {
            thrust: thrust[..self.allocation().count()].to_vec(),
            external: std::iter::once(vehicle).chain(links).collect(),
            fins: given.fins[..self.scene().vehicle.fins.len()].to_vec(),
            joint_command: self.scene_of(i).joints().enumerate().map(torque).collect(),
            joint_acceleration: self.scene_of(i).joints().zip(&given.target).map(acceleration).collect(),
        }
    }

    /// Thrusters of instance `i` under commands, where they have dynamics.
    pub(super) fn propulsion(&self, i: usize, command: &Thrusts) -> Option<ThrusterDynamics<f64>> {
        let (compiled, factors) = (self.compiled_of(i), self.factors(i));
        let thrusters = &compiled.system.thrusters;
        (!thrusters.is_empty()).then(|| {
            let mut propulsion = ThrusterDynamics::blank();
            propulsion.thrust = self.state(i).thrust;
            let gains = self.storage.losses(i).map(|loss| factors.thrust * (1.0 - loss));
            propulsion.command(thrusters, command, &gains, (self.options().dt, factors.thruster_lag));
            propulsion
        })
    }

    /// V_r of the vehicle of instance `i`. `[HC eq. 23]`
    pub(super) fn twist_through_water(&self, i: usize) -> lie::Vector6<f64> {
        let state = self.state(i);
        let water = state.rotation.tr_mul(&self.flow(i).velocity);
        lie::Vector6::from_array((state.twist - Vector6::new(water.x, water.y, water.z, 0.0, 0.0, 0.0)).into())
    }
}

/// Wrench of the vehicle's servo.
fn station_wrench(compiled: &Compiled, state: &State, given: &InstanceLoads) -> Vector6<f64> {
    let Some(gains) = &compiled.system.vehicle_servo else { return Vector6::zeros() };
    let pose = |rotation: &na::Matrix3<f64>, position: &na::Vector3<f64>| Pose {
        rotation: Matrix3(rotation.transpose().into()),
        position: Vector3((*position).into()),
    };
    let (rotation, position) = &given.station;
    let station = StationServo { target: pose(rotation, position) };
    let twist = lie::Vector6::from_array(state.twist.into());
    station.wrench(gains, &Place { pose: pose(&state.rotation, &state.position), twist }).to_array().into()
}

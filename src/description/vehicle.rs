//! The vehicle: a body with thrusters.

use nalgebra::{Vector3, Vector6};
use serde::{Deserialize, Serialize};

use super::{Body, Fin, ForwardDamping, MeshFile, Shape, Tether, ThrustMap, Water};
use crate::keys::numbers;

/// Supply voltage of a vehicle that states none, V: a lithium battery of four cells, well charged.
pub const VOLTAGE: f64 = 16.0;

/// Base body with its thrusters, fins and tether.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vehicle {
    /// Name of the vehicle, for people.
    pub name: String,
    /// Fixed at its initial pose in the world, so that the arm has a fixed base. `[HC eq. 27]`
    #[serde(default)]
    pub fixed: bool,
    /// Rigid body and hydrodynamics.
    pub body: Body,
    /// Thrusters, in the order of every thrust array.
    #[serde(default)]
    pub thrusters: Vec<Thruster>,
    /// Time constant of every thruster without its own, s.
    pub thruster_lag: Option<f64>,
    /// Supply voltage of the thrusters whose map is a bench table, V; 16 V by default.
    pub voltage: Option<f64>,
    /// Fins and other lifting surfaces, in the order of every fin array; at most 8.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fins: Vec<Fin>,
    /// Cable on the vehicle, if any.
    pub tether: Option<Tether>,
    /// Damping by forward speed.
    pub forward_damping: Option<ForwardDamping>,
    /// Gains of the vehicle's station-keeping PD.
    pub servo: Option<VehicleServo>,
    /// Shape in pictures.
    pub shape: Option<Shape>,
    /// Meshes in pictures, in place of shape and thrusters.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub meshes: Vec<MeshFile>,
}

/// A thruster: a force along an axis at a point. `[HC eq. 25]`
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thruster {
    /// Name, by which keys select the thruster: `vehicle.thrusters[NAME]`.
    pub name: String,
    /// Position in the vehicle frame, m.
    #[serde(with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Direction of the force on the vehicle at positive thrust; normalised on reading.
    #[serde(with = "numbers::vector3")]
    pub axis: Vector3<f64>,
    /// Minimum and maximum thrust, N, at which commands and thrusts saturate.
    #[serde(deserialize_with = "numbers::array")]
    pub limits: [f64; 2],
    /// Time constant tau of its first-order lag, `tau T' = T(command) - T`, s. Without it and
    /// [`Vehicle::thruster_lag`] thrust follows at once.
    pub lag: Option<f64>,
    /// Maximum magnitude of commands that give exactly 0 N, N.
    pub dead_band: Option<f64>,
    /// Static map from command to thrust in still water. Without it thrust equals the command.
    pub map: Option<ThrustMap>,
    /// Loss coefficient k of inflow along the thrust at the speed s: `|T| - k sqrt(|T|) s`, at least 0; N^(1/2) s/m. `[KC06]`
    pub ambient_flow: Option<f64>,
    /// Thrust deduction fraction t of the hull. `[F21 ch. 9]`
    pub deduction: Option<f64>,
    /// Additional wrench on the hull per newton of thrust, vehicle frame at its origin, 1 and m: propeller torque, jets on the
    /// hull.
    #[serde(default, deserialize_with = "numbers::optional_array")]
    pub induced: Option<[f64; 6]>,
}

impl Thruster {
    /// An ideal thruster, whose thrust is the command within its limits.
    pub fn new(name: impl Into<String>, position: Vector3<f64>, axis: Vector3<f64>, limits: [f64; 2]) -> Self {
        Self { name: name.into(), position, axis, limits, ..Self::default() }
    }

    /// Column of T_TCM: wrench on the vehicle per newton of thrust. `[HC eq. 25]`
    pub fn wrench(&self) -> Vector6<f64> {
        let moment = self.position.cross(&self.axis);
        let [axis, moment] = [self.axis, moment].map(|part| part * (1.0 - self.deduction.unwrap_or(0.0)));
        let direct = Vector6::new(axis.x, axis.y, axis.z, moment.x, moment.y, moment.z);
        self.induced.map_or(direct, |induced| direct + Vector6::from(induced))
    }
}

impl Vehicle {
    /// Deflections of the fins without command, rad.
    pub fn deflections(&self) -> Vec<f64> {
        self.fins.iter().map(|fin| fin.deflection).collect()
    }

    /// Shape in pictures; without one the homogeneous box of the body's mass and inertia, or the cube of its volume.
    pub fn outline(&self, water: &Water) -> Shape {
        self.shape.clone().unwrap_or_else(|| Shape::homogeneous(&self.body, water))
    }

    /// Time constant of thruster `i`, s; 0 without lag.
    pub fn lag(&self, i: usize) -> f64 {
        self.thrusters[i].lag.or(self.thruster_lag).unwrap_or(0.0)
    }

    /// Supply voltage of the thrusters, V.
    pub fn supply_voltage(&self) -> f64 {
        self.voltage.unwrap_or(VOLTAGE)
    }

    /// Sets the time constant of all thrusters, s.
    pub fn set_thruster_lag(&mut self, lag: f64) {
        self.thruster_lag = Some(lag);
        self.thrusters.iter_mut().for_each(|thruster| thruster.lag = None);
    }

    /// True if any thruster is not ideal.
    pub fn has_thruster_dynamics(&self) -> bool {
        let stated = |x: Option<f64>| x.is_some_and(|x| x != 0.0);
        let dynamic = |(i, t): (usize, &Thruster)| {
            self.lag(i) != 0.0 || stated(t.dead_band) || t.map.is_some() || stated(t.ambient_flow)
        };
        self.thrusters.iter().enumerate().any(dynamic)
    }
}

/// Gains of the paper's PD on the vehicle: `F = -kp e - kd V`, per body axis `[x y z; roll pitch yaw]`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleServo {
    /// Proportional gains, N/m and N m/rad.
    #[serde(deserialize_with = "numbers::array")]
    pub kp: [f64; 6],
    /// Derivative gains, N s/m and N m s/rad.
    #[serde(deserialize_with = "numbers::array")]
    pub kd: [f64; 6],
}

//! A scene: water, vehicle, arm, payload, contact and fixtures.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::body::InertiaPoint;
use super::{Arm, Body, Contact, Fixture, Frame, Integration, Provenance, Vehicle};
use crate::keys::numbers;

/// Vehicle, arm and water: all numbers of a simulation but its state and options.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Name of a shipped scene, or chosen by the user.
    pub name: String,
    /// One paragraph: the robot, and the reliability of its numbers.
    #[serde(default)]
    pub summary: String,
    /// Density, gravity and current.
    pub water: Water,
    /// Base body with its thrusters, fins and tether.
    pub vehicle: Vehicle,
    /// The arm, if any.
    pub arm: Option<Arm>,
    /// Payload fixed to an end effector (to the vehicle if there is no arm).
    pub payload: Option<Payload>,
    /// Spheres on the robot and shapes that they touch, if any.
    pub contact: Option<Contact>,
    /// Mechanisms in the world.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fixtures: Vec<Fixture>,
    /// Integrator and step that its motion needs, where they are stated.
    pub integration: Option<Integration>,
    /// Provenance of the numbers.
    #[serde(default)]
    pub provenance: Provenance,
}

/// Water of unlimited extent, in uniform motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Water {
    /// Density, kg/m3; 0 is a vacuum.
    pub density: f64,
    /// Gravity in world axes, m/s2.
    #[serde(with = "numbers::vector3")]
    pub gravity: Vector3<f64>,
    /// Uniform current in world axes, m/s.
    #[serde(default, with = "numbers::vector3")]
    pub current: Vector3<f64>,
}

/// Payload at an end effector.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Payload {
    /// End effector that carries it; `arm.end_effector` if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub on: Option<String>,
    /// Payload frame in the end-effector frame.
    #[serde(default)]
    pub frame: Frame,
    /// Rigid body and hydrodynamics in the payload frame.
    pub body: Body,
}

impl Scene {
    /// The scene with factors on mass (and inertia), added mass, linear damping, quadratic damping and displaced volume of all
    /// bodies, and an additional point mass at the end effector, kg.
    pub fn varied(&self, [mass, added_mass, linear, quadratic, volume, payload]: [f64; 6]) -> Self {
        let mut scene = self.clone();
        for body in scene.bodies_mut() {
            body.mass *= mass;
            body.inertia *= mass;
            body.weight = None;
            body.added_mass *= added_mass;
            body.damping.linear *= linear;
            body.damping.quadratic *= quadratic;
            for displaced in [&mut body.volume, &mut body.buoyancy].into_iter().flatten() {
                *displaced *= volume;
            }
        }
        scene.vehicle.scale_linear_damping(linear);
        if payload != 0.0 {
            scene.carry(payload);
        }
        scene
    }

    /// Adds a point mass at the end effector in use.
    fn carry(&mut self, mass: f64) {
        if let (Some(arm), Some(payload)) = (&mut self.arm, &self.payload)
            && !arm.coincide(arm.payload_end_effector(payload), &arm.end_effector)
        {
            return arm.attach(Body::point(mass));
        }
        let payload =
            self.payload.get_or_insert_with(|| Payload { on: None, frame: Frame::default(), body: Body::point(0.0) });
        let (at, body) = (-(payload.frame.rotation().transpose() * payload.frame.position), &mut payload.body);
        let total = body.mass + mass;
        let offset = (at - body.center_of_mass).cross_matrix();
        let about_com = body.inertia_about_com() - offset * offset * (body.mass * mass / total);
        body.center_of_mass = (body.center_of_mass * body.mass + at * mass) / total;
        (body.mass, body.inertia, body.inertia_at, body.weight) = (total, about_com, InertiaPoint::Com, None);
    }
}

//! A scene: water, vehicle, arm and payload.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::body::InertiaPoint;
use super::{Arm, Body, Frame, Provenance, Vehicle, numbers};

/// Everything that is simulated together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Name: of a shipped scene, or the user's own.
    pub name: String,
    /// One paragraph for people: what it is and how far its numbers can be trusted.
    #[serde(default)]
    pub summary: String,
    /// The water.
    pub water: Water,
    /// The vehicle.
    pub vehicle: Vehicle,
    /// The arm, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub arm: Option<Arm>,
    /// A body held by the end effector (by the vehicle if there is no arm), by fixed loading.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub payload: Option<Payload>,
    /// Where each number comes from.
    #[serde(default)]
    pub provenance: Provenance,
}

/// The water, which fills the world.
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

/// A body carried at the end effector.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Payload {
    /// Payload frame in the end-effector frame.
    #[serde(default)]
    pub frame: Frame,
    /// Rigid body and hydrodynamics in the payload frame.
    pub body: Body,
}

impl Scene {
    /// The scene with factors on mass (and inertia), added mass, linear drag, quadratic drag and displaced volume of
    /// every body, and then a point mass at the end effector, kg.
    pub fn varied(&self, [mass, added_mass, linear, quadratic, volume, payload]: [f64; 6]) -> Self {
        let mut scene = self.clone();
        let arm =
            scene.arm.iter_mut().flat_map(|arm| arm.base.iter_mut().chain(arm.links.iter_mut().map(|l| &mut l.body)));
        let held = scene.payload.iter_mut().map(|payload| &mut payload.body);
        for body in std::iter::once(&mut scene.vehicle.body).chain(arm).chain(held) {
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
        if payload != 0.0 {
            scene.carry(payload);
        }
        scene
    }

    /// Adds a point mass at the end effector.
    fn carry(&mut self, mass: f64) {
        let held = self.payload.get_or_insert_with(|| Payload { frame: Frame::default(), body: Body::point(0.0) });
        let (at, body) = (-(held.frame.rotation().transpose() * held.frame.position), &mut held.body);
        let total = body.mass + mass;
        let apart = (at - body.center_of_mass).cross_matrix();
        let about_com = body.inertia_about_com() - apart * apart * (body.mass * mass / total);
        body.center_of_mass = (body.center_of_mass * body.mass + at * mass) / total;
        (body.mass, body.inertia, body.inertia_at, body.weight) = (total, about_com, InertiaPoint::Com, None);
    }
}

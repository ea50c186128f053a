//! Spheres of contact on the robot.

use nalgebra::{Matrix3, Vector3};

use super::Vector;
use super::hull::single;
use super::mesh::Mesh;
use super::paint::Paint;
use crate::description::{JointKind, Parent, Scene};
use crate::system::{EndEffector, Joints};

/// Translucent: the tool is seen in it.
const SPHERE: Paint = Paint::new(0x38C9D6).glossy(0.3).clear(0.45);

/// Spheres of a scene.
#[derive(Debug)]
pub struct Spheres(Vec<Ball>);

#[derive(Debug)]
struct Ball {
    /// Frame of the base or link that carries it; none on the vehicle.
    carrier: Option<EndEffector>,
    position: Vector3<f64>,
    radius: f64,
}

/// A sphere on a moving body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodySphere {
    /// Number of the body: 0 for the vehicle, i + 1 for the link of joint i.
    pub body: usize,
    /// Centre in the frame of the body, m.
    pub center: Vector3<f64>,
    /// Radius, m.
    pub radius: f64,
}

impl Ball {
    /// Centre in the vehicle frame.
    fn center(&self, q: &Joints) -> Vector3<f64> {
        let Some(carrier) = &self.carrier else { return self.position };
        let (rotation, origin) = carrier.pose(q);
        rotation * self.position + origin
    }
}

impl Spheres {
    /// Spheres of a checked scene.
    pub fn new(scene: &Scene) -> Self {
        let frames = EndEffector::links(scene);
        let carrier = |name: &str| match scene.arm.as_ref().and_then(|arm| arm.named(name))? {
            Parent::Link(k) => frames.get(1 + k).cloned(),
            Parent::Base => frames.first().cloned(),
            Parent::Vehicle => None,
        };
        let spheres = scene.contact.iter().flat_map(|contact| &contact.spheres);
        let ball = |sphere: &crate::description::Sphere| Ball {
            carrier: carrier(&sphere.on),
            position: sphere.position,
            radius: sphere.radius,
        };
        Self(spheres.map(ball).collect())
    }

    /// Adds the spheres in the vehicle frame.
    pub fn draw(&self, mesh: &mut Mesh, q: &Joints) {
        for ball in &self.0 {
            mesh.ellipsoid(single(&ball.center(q)), Vector::repeat(ball.radius as f32), 10, |_| SPHERE);
        }
    }

    /// The spheres in the frames of their moving bodies, in the order of the scene.
    pub fn in_bodies(&self, scene: &Scene) -> Vec<BodySphere> {
        let q = scene.home();
        let arm = scene.arm.iter();
        let joints = arm.flat_map(|arm| {
            std::iter::once(arm.mount.joint.as_ref()).chain(arm.links.iter().map(|link| Some(&link.joint)))
        });
        let moves = joints.map(|joint| joint.is_some_and(|joint| joint.kind != JointKind::Fixed));
        let frames = EndEffector::links(scene);
        let moving = frames.iter().zip(moves).filter(|(_, moves)| *moves).map(|(frame, _)| frame.pose(&q));
        let bodies: Vec<_> = std::iter::once((Matrix3::identity(), Vector3::zeros())).chain(moving).collect();
        let local = |ball: &Ball| {
            let body = ball.carrier.as_ref().map_or(0, EndEffector::body);
            let (rotation, origin) = bodies[body];
            BodySphere { body, center: rotation.transpose() * (ball.center(&q) - origin), radius: ball.radius }
        };
        self.0.iter().map(local).collect()
    }
}

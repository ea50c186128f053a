//! The place in front of a robot where it works on a fixture: the tool, the fixture, and a panel that carries it.

use nalgebra::{Matrix3, Vector3};

use super::pose::Pose;
use crate::description::{
    BASE, Contact, ContactGeometry, ContactShape, Fixture, Frame, Joint, MAX_JOINTS, Parent, Scene, Sphere, VEHICLE,
    WORLD,
};
use crate::dynamics::tool_contact::TOOL_SPHERES;
use crate::error::TaskError;
use crate::system::EndEffector;

/// Radius of the spheres of a tool that a task adds, m.
const TIP: f64 = 0.008;
/// Width and thickness of the panel, m.
const PANEL: [f64; 2] = [0.6, 0.02];
/// Slip speed of the shapes, m/s: a compromise between creep and step size.
const SLIP_SPEED: f64 = 0.01;

/// A robot at home, level at the world origin, and the work in front of it. The axis of the work is the vehicle's x axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Workplace {
    /// The end effector in the world.
    pub end_effector: Pose,
    /// Spheres on the end effector's body: centres in the world, m, and radii, m.
    pub tool: Vec<(Vector3<f64>, f64)>,
    /// Their indices among the spheres of the scene.
    pub indices: Vec<usize>,
    pub scene: Scene,
}

impl Workplace {
    /// Along the vehicle's x axis, away from the robot.
    pub fn axis() -> Vector3<f64> {
        Vector3::x()
    }

    /// In front of the robot of a scene. A robot without spheres on its end effector's body gets some at these places relative to
    /// the end effector at home, m, world axes.
    pub fn new(mut scene: Scene, tips: &[Vector3<f64>]) -> Result<Self, TaskError> {
        let (on, frame) = carrier(&scene);
        let (rotation, _) = EndEffector::new(&scene).pose(&scene.home());
        let contact = scene.contact.get_or_insert_with(Contact::default);
        if contact.spheres.iter().all(|sphere| sphere.on != on) {
            contact.spheres.extend(tips.iter().zip(1..).map(|(tip, k)| Sphere {
                name: format!("tool-{k}"),
                on: on.clone(),
                position: frame.position + frame.rotation() * (rotation.transpose() * tip),
                radius: TIP,
            }));
        }
        let this = Self::of(scene);
        if this.tool.len() > TOOL_SPHERES {
            let found = this.tool.len();
            return this.refuse(format!("\"{on}\" has {found} contact spheres, but a tool has at most {TOOL_SPHERES}"));
        }
        Ok(this)
    }

    /// In front of the robot of a scene whose tool has its spheres.
    pub fn of(scene: Scene) -> Self {
        let (on, frame) = carrier(&scene);
        let (rotation, position) = EndEffector::new(&scene).pose(&scene.home());
        let (mut tool, mut indices) = (Vec::new(), Vec::new());
        let spheres = scene.contact.iter().flat_map(|contact| &contact.spheres).enumerate();
        for (k, sphere) in spheres.filter(|(_, sphere)| sphere.on == on) {
            let from_end_effector = frame.rotation().transpose() * (sphere.position - frame.position);
            tool.push((position + rotation * from_end_effector, sphere.radius));
            indices.push(k);
        }
        Self { end_effector: Pose { position, rotation }, tool, indices, scene }
    }

    /// Error of a scene that does not fit.
    pub fn refuse<T>(&self, reason: String) -> Result<T, TaskError> {
        Err(TaskError::Scene { scene: self.scene.name.clone(), reason })
    }

    /// Adds a fixture, whose frame is that of its joint, with its shapes, and a panel at a distance behind the fixture's origin, m.
    pub fn add(
        &mut self,
        name: &str,
        joint: Joint,
        shapes: Vec<(&str, Frame, ContactGeometry)>,
        behind: f64,
    ) -> Result<(), TaskError> {
        let coordinates = self.scene.coordinates().count();
        if coordinates >= MAX_JOINTS {
            return self.refuse(format!("it has {coordinates} joints, but the fixture needs one of the {MAX_JOINTS}"));
        }
        if self.scene.fixtures.iter().any(|fixture| fixture.name == name) {
            return self.refuse(format!("it has a fixture \"{name}\" already, which the task adds"));
        }
        let at = Frame::new(joint.frame.position + Self::axis() * (behind + PANEL[1] / 2.0), &Matrix3::identity());
        let size = Vector3::new(PANEL[1], PANEL[0], PANEL[0]);
        let contact = self.scene.contact.get_or_insert_with(Contact::default);
        let mut add = |on: &str, name: String, frame, geometry| {
            let law = Contact::default();
            contact.shapes.push(ContactShape {
                name,
                on: on.to_owned(),
                frame,
                geometry,
                stiffness: Some(law.stiffness),
                dissipation: Some(law.dissipation),
                ramp: Some(law.ramp),
                friction: Some(law.friction),
                slip_speed: Some(SLIP_SPEED),
                colour: None,
            });
        };
        add(WORLD, format!("{name}-panel"), at, ContactGeometry::Box { size });
        for (part, frame, geometry) in shapes {
            add(name, format!("{name}-{part}"), frame, geometry);
        }
        self.scene.fixtures.push(Fixture { name: name.to_owned(), joint, body: None });
        match self.scene.check() {
            Ok(_) => Ok(()),
            Err(error) => self.refuse(error.to_string()),
        }
    }
}

/// Body of the end effector, and the end effector's frame on it.
fn carrier(scene: &Scene) -> (String, Frame) {
    let Some(arm) = &scene.arm else { return (VEHICLE.to_owned(), Frame::default()) };
    let on = match arm.carrier(&arm.end_effector) {
        Some(Parent::Link(k)) => arm.links[k].name.as_str(),
        Some(Parent::Base) => BASE,
        Some(Parent::Vehicle) | None => VEHICLE,
    };
    (on.to_owned(), arm.end_effector.frame())
}

/// Frame at a position whose z axis is along the work and whose x axis is along `across`, which is perpendicular to it.
pub(super) fn facing(position: Vector3<f64>, across: Vector3<f64>) -> Frame {
    let z = Workplace::axis();
    Frame::new(position, &Matrix3::from_columns(&[across, z.cross(&across), z]))
}

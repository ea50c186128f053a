//! Contact and fixtures of the closed form: the same laws on dense poses.

use nalgebra::Vector6;

use super::closed_form::{ClosedForm, Loads};
use super::closed_form_model::{BodyFrame, ClosedFormModel};
use super::dense::{DenseContact, DensePose, MovingFrame, angular, force_at, linear, stack};
use crate::description::{Arm, Body, Contact as ContactTables, Fixture, Link, Parent, Scene, Vehicle};
use crate::error::DynamicsError;
use crate::system::{Flow, State};

/// Spheres, shapes and fixtures of a scene.
#[derive(Debug, Clone)]
pub(super) struct Surroundings {
    contact: Option<ContactTables>,
    /// Body of each sphere in the closed form.
    spheres: Vec<BodyFrame>,
    /// Fixture of each shape, if it is on one.
    shapes: Vec<Option<usize>>,
    /// Each fixture as an arm on a fixed vehicle at the world's origin.
    fixtures: Vec<ClosedFormModel>,
}

/// A contact of a scene at a state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Index of the sphere.
    pub sphere: usize,
    /// Index of the shape.
    pub shape: usize,
    /// Places and forces, world axes.
    pub at: DenseContact,
}

impl std::ops::Deref for Contact {
    type Target = DenseContact;

    fn deref(&self) -> &DenseContact {
        &self.at
    }
}

/// The scene of a fixture by itself.
fn alone(scene: &Scene, fixture: &Fixture) -> Scene {
    let Fixture { name, joint, body } = fixture.clone();
    let vehicle = Vehicle { fixed: true, body: Body::default(), ..Vehicle::default() };
    let arm = Arm { links: vec![Link { name, parent: None, joint, body, meshes: Vec::new() }], ..Arm::default() };
    Scene { vehicle, arm: Some(arm), payload: None, ..scene.robot() }
}

impl Surroundings {
    pub(super) fn new(scene: &Scene) -> Result<Self, DynamicsError> {
        let body = |name: &str| match scene.arm.as_ref().and_then(|arm| arm.named(name)) {
            Some(Parent::Link(k)) => 2 + k,
            Some(Parent::Base) => 1,
            Some(Parent::Vehicle) | None => 0,
        };
        let contact = scene.contact.clone();
        let (mut spheres, mut shapes) = (Vec::new(), Vec::new());
        if let Some(contact) = &contact {
            let of = |(on, position)| (body(on), DensePose::shift(position));
            spheres = contact.spheres.iter().map(|sphere| of((sphere.on.as_str(), sphere.position))).collect();
            let fixture = |name: &str| scene.fixtures.iter().position(|fixture| fixture.name == name);
            shapes = contact.shapes.iter().map(|shape| fixture(&shape.on)).collect();
        }
        let fixtures = scene.fixtures.iter().map(|fixture| ClosedFormModel::new(&alone(scene, fixture)));
        Ok(Self { contact, spheres, shapes, fixtures: fixtures.collect::<Result<_, _>>()? })
    }

    /// Closed forms of the fixtures at their coordinates and rates.
    pub(super) fn fixtures_at(&self, q: &[f64], qd: &[f64], flow: &Flow) -> Vec<ClosedForm<'_>> {
        let fixtures = self.fixtures.iter().enumerate();
        fixtures
            .map(|(k, model)| {
                let mut state = State::default();
                (state.q[0], state.qd[0]) = (q[k], qd[k]);
                model.at(&state, *flow)
            })
            .collect()
    }
}

impl ClosedForm<'_> {
    /// A frame on a body, in motion.
    fn moving_frame(&self, (body, frame): BodyFrame) -> MovingFrame {
        let pose = self.pose_of((body, frame));
        let twist = frame.adjoint_inverse() * self.equations.bodies[body].twist;
        MovingFrame { pose, velocity: pose.rotation * linear(&twist), spin: pose.rotation * angular(&twist) }
    }

    /// Every sphere with every shape, in the order of shapes and spheres, those apart included.
    pub fn contacts(&self) -> Vec<Contact> {
        let surroundings = &self.model.surroundings;
        let Some(contact) = &surroundings.contact else { return Vec::new() };
        let mut contacts = Vec::new();
        for (k, shape) in contact.shapes.iter().enumerate() {
            let frame = DensePose::from_frame(&shape.frame);
            let place = match surroundings.shapes[k] {
                // Vehicle and base come before the fixture's link.
                Some(fixture) => self.fixtures[fixture].moving_frame((2, frame)),
                None => MovingFrame { pose: frame, velocity: Default::default(), spin: Default::default() },
            };
            for (i, sphere) in contact.spheres.iter().enumerate() {
                let ball = self.moving_frame(surroundings.spheres[i]);
                let at = DenseContact::new(&ball, sphere.radius, &place, &shape.geometry, &contact.law(shape));
                contacts.push(Contact { sphere: i, shape: k, at });
            }
        }
        contacts
    }

    /// Wrenches of the contacts on the moving bodies, vehicle first, N and N m.
    pub(super) fn contact_wrenches(&self) -> Vec<Vector6<f64>> {
        let mut wrenches = vec![Vector6::zeros(); self.moving.len()];
        for contact in self.contacts() {
            let (body, _) = self.model.surroundings.spheres[contact.sphere];
            let carrier = self.equations.bodies[body].carrier;
            let place = self.world_pose(carrier);
            let force = place.rotation.tr_mul(&contact.force);
            let at = place.rotation.tr_mul(&(contact.point - place.position));
            if let Some(k) = self.moving.iter().position(|&moving| moving == carrier) {
                wrenches[k] += force_at(&force, &at);
            }
        }
        wrenches
    }

    /// Wrench of the contacts on a fixture, in its frame, N and N m.
    fn wrench_on_fixture(&self, fixture: usize) -> Vector6<f64> {
        let place = self.fixtures[fixture].world_pose(2);
        let on_it = |contact: &Contact| self.model.surroundings.shapes[contact.shape] == Some(fixture);
        let wrench = |contact: Contact| {
            let force = -place.rotation.tr_mul(&contact.force);
            let at = place.rotation.tr_mul(&(contact.point - place.position));
            stack(&force, &at.cross(&force))
        };
        self.contacts().into_iter().filter(on_it).map(wrench).sum()
    }

    /// Accelerations of the fixtures without actuators, rad/s2 or m/s2.
    ///
    /// # Errors
    /// As [`Self::accelerations`].
    pub fn fixture_accelerations(&self, torques: &[f64]) -> Result<Vec<f64>, DynamicsError> {
        let accelerate = |(k, form): (usize, &ClosedForm)| {
            let external = [Vector6::zeros(), self.wrench_on_fixture(k)];
            let joint_command = torques.get(k..=k).unwrap_or_default();
            Ok(form.accelerations(&Loads { external: &external, joint_command, ..Loads::default() })?[6])
        };
        self.fixtures.iter().enumerate().map(accelerate).collect()
    }

    /// Power put into the fixtures besides their contacts, W.
    pub(super) fn fixture_power(&self) -> Result<f64, DynamicsError> {
        self.fixtures.iter().map(|form| Ok(form.power(&Loads::default())?.total())).sum()
    }
}

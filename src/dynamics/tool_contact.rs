//! Contacts of a tool with one fixture, as tasks assess them.

use super::contact::{link_places, relative_motion, shape_at, sphere_at, touches};
use super::link::LinkScratch;
use super::place::Place;
use crate::contact::{ContactTerms, contact_force};
use crate::lane::{Lane, Param, Routine};
use crate::lie::{Pose, Vector3, Vector6};
use crate::system::{JOINTS, System};

/// Maximum number of spheres of a tool.
pub const TOOL_SPHERES: usize = 4;

/// Contact of one sphere of a tool with all shapes of the fixture.
#[derive(Debug, Clone, Copy)]
pub struct ToolContact<L> {
    /// Sum of the normal forces on the sphere, world axes, N.
    pub normal_force: Vector3<L>,
    /// Sum of the forces on the sphere, friction included, world axes, N.
    pub force: Vector3<L>,
    /// Minimum distance between the surfaces of sphere and fixture, m; negative where they penetrate.
    pub clearance: L,
    /// Velocity of the centre, world axes, m/s.
    pub velocity: Vector3<L>,
}

/// Contacts of a tool with a fixture, and the sum of the normal forces of all contacts of the robot; a routine of its own.
pub struct ToolContacts<'a, L, P, B> {
    /// The system, with contact.
    pub system: &'a System<P, B>,
    /// Spheres of the tool, by their indices.
    pub spheres: &'a [usize],
    /// Index of the fixture's joint.
    pub fixture: usize,
    /// Pose of the vehicle in the world; by reference, as copies of it would be calls.
    pub pose: &'a Pose<L>,
    /// Absolute twist of the vehicle, body axes.
    pub twist: Vector6<L>,
    /// Joint coordinates.
    pub q: &'a [L; JOINTS],
    /// Joint rates.
    pub qd: &'a [L; JOINTS],
    /// The result, one entry for each of `spheres`.
    pub contacts: &'a mut [ToolContact<L>; TOOL_SPHERES],
    /// The result: sum of the normal forces of all contacts, N.
    pub force: &'a mut L,
}

/// Distance of a sphere that meets no shape, m.
const FAR: f64 = 1e3;

impl<L: Lane> ToolContact<L> {
    /// Without contact.
    #[inline(always)]
    pub fn none() -> Self {
        let zero = Vector3::zero();
        Self { normal_force: zero, force: zero, clearance: L::c(FAR), velocity: zero }
    }
}

impl<L: Lane, P: Param<L>, B> Routine<L> for ToolContacts<'_, L, P, B> {
    #[inline(always)]
    fn run(&mut self) {
        let Self { system, spheres: tool, fixture, pose, twist, q, qd, contacts, force } = self;
        let Some(ContactTerms { spheres, shapes }) = &system.contact else { return };
        let vehicle = &Place { pose: **pose, twist: *twist };
        let (mut links, mut places) = ([LinkScratch::new(); JOINTS], [Place::world(); JOINTS]);
        let n = system.chain().len();
        link_places(system, true, vehicle, (q, qd), &mut links[..n], &mut places);
        **force = L::zero();
        for k in 0..TOOL_SPHERES {
            contacts[k] = ToolContact::none();
        }
        for i in 0..spheres.len() {
            let sphere = &spheres[i];
            let at = sphere_at(sphere, vehicle, &places);
            // The number of spheres of the tool for one that is not part of it.
            let mut of_tool = TOOL_SPHERES;
            for k in 0..tool.len().min(TOOL_SPHERES) {
                if tool[k] == i {
                    of_tool = k;
                    contacts[k].velocity = at.0.motion_at(at.1).linear;
                }
            }
            for shape in shapes {
                let shape_at = shape_at(shape, &places);
                let (motion, _) = relative_motion(&at, &shape_at);
                let on_fixture = of_tool < TOOL_SPHERES && shape.body == *fixture + 1;
                if on_fixture {
                    let apart = shape.geometry.distance(motion.center).distance - sphere.radius.get();
                    contacts[of_tool].clearance = contacts[of_tool].clearance.min(apart);
                }
                if !touches(shape, sphere, motion.center, L::zero()) {
                    continue;
                }
                let found = contact_force(&shape.geometry, &shape.law, sphere.radius.get(), &motion);
                **force += found.normal_force;
                if on_fixture {
                    let (rotation, contact) = (&shape_at.1.rotation, &mut contacts[of_tool]);
                    let normal = shape.geometry.distance(motion.center).normal;
                    contact.normal_force = rotation.apply(normal).scale_add(found.normal_force, contact.normal_force);
                    contact.force = rotation.apply(found.wrench.linear) + contact.force;
                }
            }
        }
    }
}

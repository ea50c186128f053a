//! Meshes of moving bodies, surroundings and dock, for other programs that draw.

use nalgebra::Vector3;

use super::arm::ArmModel;
use super::dock::{dock, has_dock};
use super::files::Facets;
use super::hull::hull;
use super::mesh::Mesh;
use super::surroundings::Surroundings;
use crate::description::Scene;

/// Name and mesh of each moving body of a checked scene, in its frame and in the order of their poses, then of the fixtures, of
/// the shapes in the world, if there are any, and of the dock, in the frame of the docked vehicle: empty where the scene has shapes of a dock. Links have their lengths at
/// home; planes are drawn about the origin as tiles of the width `cell`, m.
pub fn bodies(scene: &Scene, facets: &Facets, cell: f64) -> Vec<(String, Mesh)> {
    let (envelope, mut vehicle, _) = hull(scene, facets);
    let mut arm = ArmModel::new(scene, facets).map_or_else(Vec::new, |arm| arm.bodies(&scene.home())).into_iter();
    if let Some(foot) = arm.next() {
        vehicle.append(&foot, |vertex| *vertex);
    }
    let mut garage = Mesh::default();
    if !has_dock(scene) {
        dock(&mut garage, &envelope);
    }
    let links = arm.enumerate().map(|(k, link)| (format!("link {}", k + 1), link));
    let vehicle = std::iter::once(("vehicle".to_owned(), vehicle));
    let surroundings = Surroundings::new(scene, cell);
    let fixtures = surroundings.fixtures().enumerate();
    let fixtures = fixtures.map(|(k, mesh)| (format!("fixture {}", k + 1), mesh.clone()));
    let mut world = Mesh::default();
    surroundings.draw_fixed(&mut world, &Vector3::zeros());
    let world = (!world.vertices.is_empty()).then(|| ("world".to_owned(), world));
    vehicle.chain(links).chain(fixtures).chain(world).chain([("dock".to_owned(), garage)]).collect()
}

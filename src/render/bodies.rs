//! Meshes of moving bodies and dock, for other programs that draw.

use super::arm::ArmModel;
use super::dock::dock;
use super::files::Facets;
use super::hull::hull;
use super::mesh::Mesh;
use crate::description::Scene;

/// Name and mesh of each moving body of a checked scene, in its frame and in the order of their poses, then of the dock, in the
/// frame of the docked vehicle. Links have their lengths at home.
pub fn bodies(scene: &Scene, facets: &Facets) -> Vec<(String, Mesh)> {
    let (envelope, mut vehicle, _) = hull(scene, facets);
    let mut arm = ArmModel::new(scene, facets).map_or_else(Vec::new, |arm| arm.bodies(&scene.home())).into_iter();
    if let Some(foot) = arm.next() {
        vehicle.append(&foot, |vertex| *vertex);
    }
    let mut garage = Mesh::default();
    dock(&mut garage, &envelope);
    let links = arm.enumerate().map(|(k, link)| (format!("link {}", k + 1), link));
    let vehicle = std::iter::once(("vehicle".to_owned(), vehicle));
    vehicle.chain(links).chain([("dock".to_owned(), garage)]).collect()
}

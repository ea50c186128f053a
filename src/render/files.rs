//! Meshes of bodies from files.

use std::collections::HashMap;

use super::Vector;
use super::hull::single;
use super::mesh::Mesh;
use super::paint::Paint;
use crate::description::MeshFile;

/// Triangle of a mesh file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facet {
    /// Corners in the file's axes, m, counterclockwise as seen from outside.
    pub corners: [Vector; 3],
    /// Red, green and blue, 0 to 1, if the file states them.
    pub colour: Option<[f32; 3]>,
}

/// Triangles of mesh files, by the files' names in the scene.
pub type Facets = HashMap<String, Vec<Facet>>;

/// Mesh of a body in its frame; none if it has no files, or if one of them is not among `facets`.
pub fn drawn(files: &[MeshFile], facets: &Facets, paint: Paint) -> Option<Mesh> {
    let mut mesh = Mesh::default();
    for file in files {
        let (rotation, position) = (file.frame().rotation().map(|x| x as f32), single(&file.position));
        let scale = single(&file.scale);
        for facet in facets.get(&file.file)? {
            let [a, mut b, mut c] = facet.corners.map(|at| rotation * at.component_mul(&scale) + position);
            if file.scale.product() < 0.0 {
                std::mem::swap(&mut b, &mut c);
            }
            let colour = facet.colour.map_or(paint.colour, |colour| colour.map(|c| c * c));
            mesh.polygon(&[a, b, c], Paint { colour, ..paint });
        }
    }
    (!files.is_empty()).then_some(mesh)
}

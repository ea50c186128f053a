//! Mesh files that draw bodies.

use std::f64::consts::PI;
use std::path::Path;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use toml::Value;

use super::{Frame, Scene};
use crate::error::Problem;
use crate::keys::{Fault, flip, numbers, range};

/// Key of the lists of mesh files.
const KEY: &str = "meshes";

/// Mesh file that draws a body, without influence on the physics. It is read for pictures alone, and may be missing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshFile {
    /// STL, OBJ or COLLADA file; absolute after reading.
    pub file: String,
    /// Factors on its coordinates; negative ones mirror.
    #[serde(default = "ones", with = "numbers::vector3")]
    pub scale: Vector3<f64>,
    /// Origin of its axes in the body's frame, m.
    #[serde(default, with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Its axes in the body's frame: roll, pitch, yaw, rad.
    #[serde(default, with = "numbers::vector3")]
    pub rpy: Vector3<f64>,
}

fn ones() -> Vector3<f64> {
    Vector3::repeat(1.0)
}

impl MeshFile {
    /// Its axes in the body's frame.
    pub fn frame(&self) -> Frame {
        Frame { position: self.position, rpy: self.rpy }
    }

    /// The same file in this frame of a body.
    pub fn at(&self, Frame { position, rpy }: Frame) -> Self {
        Self { position, rpy, ..self.clone() }
    }

    /// Converts the pose from x forward, y starboard, z down; the file keeps its own axes.
    pub(super) fn convert_axes(&mut self) {
        flip(&mut self.position);
        let turn = |rpy| Frame { position: Vector3::zeros(), rpy };
        self.rpy = turn(Vector3::x() * PI).then(&turn(self.rpy)).rpy;
    }
}

impl Scene {
    /// Keys and lists of the mesh files of the vehicle, the arm's base and the links.
    pub fn mesh_files(&self) -> impl Iterator<Item = (String, &[MeshFile])> {
        let base = self.arm.iter().map(|arm| ("arm".to_owned(), &arm.meshes));
        let links = self.arm.iter().flat_map(|arm| arm.links.iter().enumerate());
        let links = links.map(|(i, link)| (format!("arm.links[{i}]"), &link.meshes));
        let all = std::iter::once(("vehicle".to_owned(), &self.vehicle.meshes)).chain(base).chain(links);
        all.map(|(key, list)| (format!("{key}.{KEY}"), list.as_slice()))
    }

    pub(super) fn check_mesh_files(&self) -> Result<(), Fault> {
        for (key, list) in self.mesh_files() {
            for (i, mesh) in list.iter().enumerate() {
                if mesh.file.is_empty() {
                    let reason = "must be the path of an STL, OBJ or COLLADA file";
                    return Err(Fault::new(format!("{key}[{i}].file"), Problem::Invalid { reason }));
                }
                for (k, scale) in mesh.scale.iter().enumerate() {
                    range(*scale != 0.0, *scale, "other than 0", || format!("{key}[{i}].scale[{k}]"))?;
                }
            }
        }
        Ok(())
    }
}

/// Makes the paths of all mesh files in a scene's tree of values absolute; relative ones are below `directory`.
pub fn locate(tree: &mut Value, directory: &Path) {
    match tree {
        Value::Array(list) => list.iter_mut().filter(|each| each.is_table()).for_each(|each| locate(each, directory)),
        Value::Table(table) => table.iter_mut().for_each(|(key, value)| match value {
            Value::Array(list) if key == KEY => list.iter_mut().for_each(|mesh| {
                if let Some(Value::String(file)) = mesh.get_mut("file")
                    && let (false, Ok(path)) = (file.is_empty(), std::path::absolute(directory.join(&*file)))
                {
                    *file = path.display().to_string();
                }
            }),
            value => locate(value, directory),
        }),
        _ => {}
    }
}

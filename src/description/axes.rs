//! Body axes of the tables of a scene: the project's or Fossen's.
//!
//! A table of coefficients in body axes may state `axes = "ned"`: x forward, y starboard, z down, as in Fossen's notation. Its
//! values are converted on reading to x forward, y left, z up (`"flu"`, the default) by `S = diag(1, -1, -1)`: vectors to `S v`,
//! 3x3 matrices to `S J S`, 6x6 matrices to `diag(S, S) M diag(S, S)`. S is a rotation, by pi about x, so moments, angular
//! rates, axes of rotation and roll, pitch and yaw of frames transform like any vector; angles about axes and diagonal
//! matrices stay as they are.

use std::collections::BTreeSet;

use toml::Value;

use super::{Body, MeshFile, Scene, Thruster, path};
use crate::error::Problem;
use crate::keys::{Fault, flip, flip_matrix, flip_six};
use crate::terms::TERMS;

/// Key that states the axes of a table.
const KEY: &str = "axes";

/// Axes that a table states; None where it states none.
fn stated(table: &mut Value, key: &str) -> Result<Option<bool>, Fault> {
    let Some(value) = table.as_table_mut().and_then(|table| table.remove(KEY)) else { return Ok(None) };
    match value.as_str() {
        Some("flu") => Ok(Some(false)),
        Some("ned") => Ok(Some(true)),
        _ => Err(Fault::new(path::join(key, KEY), Problem::Axes { value: path::short(&value) })),
    }
}

/// Tables of a scene in NED axes: key of the table or of the list of tables, and index in the list, 0 for a single table.
#[derive(Debug, Default)]
pub struct NedTables(BTreeSet<(String, usize)>);

impl NedTables {
    /// Removes the keys `axes` from a scene's tree of values.
    ///
    /// `vehicle.axes` holds for all tables of the vehicle; each body, thruster and table of a term may state its own.
    pub fn take(tree: &mut Value) -> Result<Self, Fault> {
        let mut ned = Self::default();
        ned.read(tree, "vehicle", None, false)?;
        let vehicle = ned.has("vehicle", 0);
        ned.read(tree, "vehicle.body", None, vehicle)?;
        ned.read(tree, "vehicle.thrusters", None, vehicle)?;
        TERMS.iter().try_for_each(|(name, _)| ned.read(tree, &format!("vehicle.{name}"), None, vehicle))?;
        ned.read(tree, "arm.base", None, false)?;
        ned.read(tree, "arm.links", Some("body"), false)?;
        ned.read(tree, "payload.body", None, false)?;
        ned.read(tree, "contact.spheres", None, false)?;
        ned.read(tree, "fixtures", Some("body"), false)?;
        Ok(ned)
    }

    /// Reads the axes of a table or of each table of a list, or of the table `inner` in it; `enclosing` where it states none.
    fn read(&mut self, tree: &mut Value, key: &str, inner: Option<&str>, enclosing: bool) -> Result<(), Fault> {
        let elements: Vec<(String, &mut Value)> = match key.split('.').try_fold(tree, |node, step| node.get_mut(step)) {
            None => Vec::new(),
            Some(Value::Array(list)) => list.iter_mut().enumerate().map(|(i, e)| (format!("{key}[{i}]"), e)).collect(),
            Some(table) => vec![(key.to_owned(), table)],
        };
        for (i, (element_key, element)) in elements.into_iter().enumerate() {
            let own = match inner {
                None => stated(element, &element_key)?,
                Some(inner) => {
                    let table = element.get_mut(inner);
                    table.map_or(Ok(None), |table| stated(table, &path::join(&element_key, inner)))?
                }
            };
            if own.unwrap_or(enclosing) {
                self.0.insert((key.to_owned(), i));
            }
        }
        Ok(())
    }

    /// True where a table, or a table of a list, is in NED axes.
    pub fn has(&self, key: &str, i: usize) -> bool {
        self.0.contains(&(key.to_owned(), i))
    }

    /// Converts these tables of a scene to the project's axes.
    pub fn convert(&self, scene: &mut Scene) {
        let body = |key: &str, i: usize, body: &mut Body| {
            if self.has(key, i) {
                convert_body(body);
            }
        };
        let vehicle = &mut scene.vehicle;
        body("vehicle.body", 0, &mut vehicle.body);
        if let (Some(shape), true) = (&mut vehicle.shape, self.has("vehicle", 0)) {
            flip(&mut shape.position);
        }
        if self.has("vehicle", 0) {
            vehicle.meshes.iter_mut().for_each(MeshFile::convert_axes);
        }
        vehicle.convert_term_axes(self);
        let thrusters = vehicle.thrusters.iter_mut().enumerate();
        thrusters
            .filter(|(i, _)| self.has("vehicle.thrusters", *i))
            .for_each(|(_, thruster)| convert_thruster(thruster));
        if let Some(arm) = &mut scene.arm {
            arm.base.iter_mut().for_each(|base| body("arm.base", 0, base));
            let bodies = arm.links.iter_mut().enumerate().filter_map(|(i, link)| Some((i, link.body.as_mut()?)));
            bodies.for_each(|(i, of_link)| body("arm.links", i, of_link));
        }
        scene.payload.iter_mut().for_each(|payload| body("payload.body", 0, &mut payload.body));
        let bodies = scene.fixtures.iter_mut().enumerate().filter_map(|(i, fixture)| Some((i, fixture.body.as_mut()?)));
        bodies.for_each(|(i, of_fixture)| body("fixtures", i, of_fixture));
        let spheres = scene.contact.iter_mut().flat_map(|contact| contact.spheres.iter_mut().enumerate());
        spheres.filter(|(i, _)| self.has("contact.spheres", *i)).for_each(|(_, sphere)| flip(&mut sphere.position));
    }
}

fn convert_body(body: &mut Body) {
    flip(&mut body.center_of_mass);
    flip(&mut body.center_of_buoyancy);
    flip_matrix(&mut body.inertia);
    // S R S has the angles S rpy.
    flip(&mut body.hydrodynamic_frame.position);
    flip(&mut body.hydrodynamic_frame.rpy);
    flip_matrix(&mut body.added_mass);
    flip_matrix(&mut body.damping.linear);
    flip_matrix(&mut body.damping.quadratic);
}

fn convert_thruster(thruster: &mut Thruster) {
    flip(&mut thruster.position);
    flip(&mut thruster.axis);
    thruster.induced.iter_mut().for_each(flip_six);
}

//! Body axes of the tables of a scene: the project's or Fossen's.
//!
//! A table of coefficients in body axes may state `axes = "ned"`: x forward, y starboard, z down, as in Fossen's notation. Its
//! values are converted on reading to x forward, y left, z up (`"flu"`, the default) by `S = diag(1, -1, -1)`: vectors to `S v`,
//! 3x3 matrices to `S J S`, 6x6 matrices to `diag(S, S) M diag(S, S)`. S is a rotation, by pi about x, so moments, angular
//! rates, axes of rotation and roll, pitch and yaw of frames transform like any vector; angles about axes and diagonal
//! matrices stay as they are.

use toml::Value;

use super::{Body, Scene, Shape, Thruster, Vehicle, path};
use crate::error::Problem;
use crate::keys::{Fault, flip, flip_matrix, flip_six};
use crate::terms::PerTerm;

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

/// Axes of a table, else of the enclosing one; true for NED.
fn table(root: &mut Value, keys: [&str; 2], enclosing: bool) -> Result<bool, Fault> {
    let found = root.get_mut(keys[0]).and_then(|table| table.get_mut(keys[1]));
    let own = found.map_or(Ok(None), |table| stated(table, &keys.join(".")))?;
    Ok(own.unwrap_or(enclosing))
}

/// Axes of a table or of the elements of a list of tables, one entry for each.
pub fn tables(root: &mut Value, keys: [&str; 2], enclosing: bool) -> Result<Vec<bool>, Fault> {
    if root.get(keys[0]).and_then(|table| table.get(keys[1])).is_some_and(Value::is_array) {
        return list(root, keys, None, enclosing);
    }
    Ok(vec![table(root, keys, enclosing)?])
}

/// Axes of the elements of a list of tables, or of a table in each of them, else of the enclosing table; true for NED.
fn list(root: &mut Value, keys: [&str; 2], inner: Option<&str>, enclosing: bool) -> Result<Vec<bool>, Fault> {
    let elements = root.get_mut(keys[0]).and_then(|table| table.get_mut(keys[1])).and_then(Value::as_array_mut);
    let axes = elements.into_iter().flatten().enumerate().map(|(i, element)| {
        let element_key = format!("{}[{i}]", keys.join("."));
        let own = match inner {
            None => stated(element, &element_key),
            Some(inner) => {
                element.get_mut(inner).map_or(Ok(None), |table| stated(table, &path::join(&element_key, inner)))
            }
        };
        Ok(own?.unwrap_or(enclosing))
    });
    axes.collect()
}

/// Tables of a scene in NED axes.
#[derive(Debug)]
pub struct NedTables {
    vehicle: bool,
    body: bool,
    thrusters: Vec<bool>,
    terms: PerTerm<Vec<bool>>,
    base: bool,
    links: Vec<bool>,
    payload: bool,
}

impl NedTables {
    /// Removes the keys `axes` from a scene's tree of values.
    ///
    /// `vehicle.axes` holds for all tables of the vehicle; each body, thruster and table of a term may state its own.
    pub fn take(tree: &mut Value) -> Result<Self, Fault> {
        let vehicle = tree.get_mut("vehicle").map_or(Ok(None), |table| stated(table, "vehicle"))?.unwrap_or(false);
        Ok(Self {
            vehicle,
            body: table(tree, ["vehicle", "body"], vehicle)?,
            thrusters: list(tree, ["vehicle", "thrusters"], None, vehicle)?,
            terms: Vehicle::take_term_axes(tree, vehicle)?,
            base: table(tree, ["arm", "base"], false)?,
            links: list(tree, ["arm", "links"], Some("body"), false)?,
            payload: table(tree, ["payload", "body"], false)?,
        })
    }

    /// Converts these tables of a scene to the project's axes.
    pub fn convert(&self, scene: &mut Scene) {
        let vehicle = &mut scene.vehicle;
        convert(self.body, Some(&mut vehicle.body), convert_body);
        convert(self.vehicle, vehicle.shape.as_mut(), |shape: &mut Shape| flip(&mut shape.position));
        vehicle.convert_term_axes(&self.terms);
        vehicle.thrusters.iter_mut().zip(&self.thrusters).for_each(|(t, &ned)| convert(ned, Some(t), convert_thruster));
        if let Some(arm) = &mut scene.arm {
            convert(self.base, arm.base.as_mut(), convert_body);
            arm.links.iter_mut().zip(&self.links).for_each(|(l, &ned)| convert(ned, Some(&mut l.body), convert_body));
        }
        convert(self.payload, scene.payload.as_mut().map(|payload| &mut payload.body), convert_body);
    }
}

fn convert<T>(ned: bool, table: Option<&mut T>, conversion: impl Fn(&mut T)) {
    if ned {
        table.into_iter().for_each(conversion);
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

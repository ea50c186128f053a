//! Hydrodynamics, buoyancy and thrusters that simulators keep in `<plugin>` elements of URDF and SDF files.
//!
//! Read: uuv_simulator and Plankton ([`uuv`]), Gazebo ([`gz`]), freefloating_gazebo ([`freefloating`]) and hippo_simulation
//! ([`hippo`]); of thrusters of other simulators the place ([`others`]). Every other plugin of the robot is noted by name. Link
//! frames of all these formats are x forward, y left, z up; signs and axes of the coefficients differ, and each reader states
//! them.

mod fins;
mod freefloating;
mod gz;
mod hippo;
mod others;
mod uuv;

use nalgebra::Matrix6;

use super::element::{Element, Result};
use super::parts::{InWater, Robot};

pub use gz::fluid_added_mass;

/// Plugins without influence on the motion of the robot in water, by parts of their names.
const WITHOUT_FORCE: [&str; 9] =
    ["physics", "usercommands", "scenebroadcaster", "sensor", "imu", "publish", "contact", "camera", "log"];

/// Maximum difference of the entries ij and ji of a published added mass that counts as rounding, relative to
/// `sqrt(A_ii A_jj)`.
const SYMMETRY: f64 = 1e-3;

/// Reads the plugins of a URDF file and the hydrodynamics in its links.
pub fn read_urdf<'a>(document: &Element<'a>, robot: &mut Robot) -> Result<()> {
    freefloating::links(document, robot)?;
    let mut plugins = Vec::new();
    for gazebo in document.children("gazebo") {
        gravity(&gazebo, robot)?;
        plugins.extend(gazebo.children("plugin"));
    }
    read(plugins, robot)
}

/// Reads the plugins of the elements of an SDF file.
pub fn read_sdf<'a>(parents: &[&Element<'a>], robot: &mut Robot) -> Result<()> {
    read(parents.iter().flat_map(|parent| parent.children("plugin")).collect(), robot)
}

/// True if a plugin of a model states hydrodynamics or a thruster.
pub fn describe_vehicle(model: &Element) -> bool {
    let attribute = |plugin: &Element, key: &'static str| plugin.node.attribute(key).unwrap_or_default().to_owned();
    let class = |plugin: Element| class(&attribute(&plugin, "filename"), &attribute(&plugin, "name"));
    model.children("plugin").map(class).any(|class| {
        class.contains("underwater_object") || class.contains("hydrodynamics") || class.contains("thruster")
    })
}

fn read(plugins: Vec<Element>, robot: &mut Robot) -> Result<()> {
    let (mut unread, mut autopilots) = (Vec::new(), Vec::new());
    for plugin in plugins {
        let attribute = |key| plugin.node.attribute(key).unwrap_or_default();
        let (file, name) = (attribute("filename"), attribute("name"));
        let class = class(file, name);
        let plugin = Element { path: format!("plugin \"{}\"", if name.is_empty() { file } else { name }), ..plugin };
        match class.as_str() {
            "uuv_underwater_object_ros_plugin" | "uuv_underwater_object_plugin" => uuv::object(&plugin, robot)?,
            "uuv_thruster_ros_plugin" | "uuv_thruster_plugin" => uuv::thruster(&plugin, robot)?,
            "uuv_fin_ros_plugin" | "uuv_fin_plugin" => fins::uuv(&plugin, robot)?,
            "system hydrodynamics" => gz::hydrodynamics(&plugin, robot)?,
            "system thruster" => gz::thruster(&plugin, robot)?,
            "system buoyancy" => gz::buoyancy(&plugin, robot)?,
            "system liftdrag" | "liftdragplugin" => fins::gazebo(&plugin, robot)?,
            "buoyancyplugin" => gz::classic_buoyancy(&plugin, robot)?,
            "freefloating_gazebo_control" => freefloating::thrusters(&plugin, robot)?,
            "freebuoyancy_gazebo" => freefloating::plugin(&plugin, robot)?,
            "ardupilotplugin" => autopilots.push(plugin),
            "hippo thruster" => hippo::thruster(&plugin, robot)?,
            "hippo hydrodynamics" => hippo::hydrodynamics(&plugin, robot)?,
            "hippo buoyancy" => hippo::buoyancy(&plugin, robot)?,
            class if class.contains("thruster") && others::thruster(&plugin, robot)? => {}
            class if WITHOUT_FORCE.iter().any(|part| class.contains(part)) => {}
            _ => unread.push(name_of(&plugin)),
        }
    }
    // Their limits are for thrusters of other plugins.
    for plugin in autopilots {
        if !gz::autopilot(&plugin, robot)? {
            unread.push(name_of(&plugin));
        }
    }
    if !unread.is_empty() {
        robot.notes.push(format!("plugins that are not read: {}", unread.join(", ")));
    }
    Ok(())
}

/// Library and line of a plugin.
fn name_of(plugin: &Element) -> String {
    let attribute = |key| plugin.node.attribute(key).filter(|text| !text.is_empty());
    format!("{} (line {})", attribute("filename").or(attribute("name")).unwrap_or_default(), plugin.line())
}

/// Kind of a plugin, in lower case: its library without prefix and suffix, or the class of a system of Gazebo.
fn class(file: &str, name: &str) -> String {
    if let Some((_, system)) = name.rsplit_once("systems::") {
        return format!("system {}", system.to_lowercase());
    }
    if let Some(class) = name.strip_prefix("hippo_gz_plugins::") {
        return format!("hippo {class}");
    }
    let file = file.rsplit('/').next().unwrap_or(file);
    let file = file.strip_prefix("lib").unwrap_or(file);
    let file = file.strip_suffix(".so").unwrap_or(file).to_lowercase();
    match file.strip_suffix("-system") {
        Some(system) => {
            let start = system.trim_start_matches("gz-sim").trim_start_matches("ignition-gazebo");
            format!("system {}", start.trim_start_matches(|c: char| c.is_ascii_digit() || c == '-').replace('-', ""))
        }
        None if file.is_empty() => name.to_lowercase(),
        None => file,
    }
}

/// Index of a link; a note if the file has none of this name.
fn link(element: &Element, name: &str, robot: &Robot) -> Option<usize> {
    let found = robot.links.iter().position(|link| link.name == name);
    if found.is_none() {
        element.note(&format!("is not read: the file has no link \"{name}\""));
    }
    found
}

/// Hydrodynamics of a link, made if there are none yet.
fn water(robot: &mut Robot, link: usize) -> &mut InWater {
    robot.links[link].water.get_or_insert_default()
}

/// `<gazebo reference="LINK">` that switches gravity off: the link weighs as much as the water that it displaces.
fn gravity(gazebo: &Element, robot: &mut Robot) -> Result<()> {
    let Some(name) = gazebo.node.attribute("reference") else { return Ok(()) };
    let off = gazebo.flag("turnGravityOff")? == Some(true) || gazebo.flag("gravity")? == Some(false);
    let found = robot.links.iter().position(|link| link.name == name);
    if let (true, Some(index)) = (off, found) {
        gazebo.note(&format!("gravity of link \"{name}\" is off: read as neutrally buoyant"));
        water(robot, index).neutral = true;
    }
    Ok(())
}

/// The matrix with the sign that is physical for it, positive on its diagonal.
///
/// The plugin of the file multiplies by `convention`, 1 or -1; a matrix whose whole diagonal has the other sign is read with the
/// other sign and noted.
///
/// # Errors
/// A diagonal with both signs.
fn positive(raw: &Matrix6<f64>, convention: f64, element: &Element, what: &str) -> Result<Matrix6<f64>> {
    let diagonal = raw.diagonal() * convention;
    let (lowest, highest) = (diagonal.min(), diagonal.max());
    if lowest >= 0.0 {
        return Ok(raw.map(|x| 0.0 + x * convention));
    }
    if highest > 0.0 {
        let problem = format!("its diagonal has both signs, but {what} has one: {:?}", raw.diagonal().as_slice());
        return element.fault(problem);
    }
    element.note(&format!("its signs would make {what} add energy: read with the opposite sign"));
    Ok(raw.map(|x| 0.0 - x * convention))
}

/// Added mass, made symmetric within the rounding of published digits.
///
/// # Errors
/// Larger asymmetry, by its entries.
fn symmetric(matrix: Matrix6<f64>, element: &Element) -> Result<Matrix6<f64>> {
    let mut changed = false;
    for (i, k) in (0..6).flat_map(|i| (i + 1..6).map(move |k| (i, k))) {
        let (upper, lower) = (matrix[(i, k)], matrix[(k, i)]);
        let scale = (matrix[(i, i)] * matrix[(k, k)]).max(0.0).sqrt();
        if (upper - lower).abs() > SYMMETRY * scale {
            let (row, column) = (i + 1, k + 1);
            let problem = format!(
                "added mass is symmetric, but row {row}, column {column} is {upper} and row {column}, column {row} is {lower}"
            );
            return element.fault(problem);
        }
        changed |= upper != lower;
    }
    if changed {
        element.note("added mass is asymmetric by its rounding: made symmetric");
    }
    Ok((matrix + matrix.transpose()) / 2.0)
}

/// Linear damping that takes energy in every motion: cross terms whose symmetric part would add energy leave their skew part,
/// which is lift.
fn dissipative(matrix: Matrix6<f64>, element: &Element) -> Matrix6<f64> {
    let symmetric = (matrix + matrix.transpose()) / 2.0;
    if symmetric.symmetric_eigenvalues().min() >= -1e-6 * symmetric.amax() {
        return matrix;
    }
    element.note("cross terms of its linear damping would add energy: the symmetric part of them is left out");
    (matrix - matrix.transpose()) / 2.0 + Matrix6::from_diagonal(&matrix.diagonal())
}

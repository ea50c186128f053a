//! Elements of freefloating_gazebo: `<buoyancy>` or `<fluid>` in links, and `<thruster>` in its control plugin.
//!
//! Sources: freefloating_gazebo, src: hydro_model_parser.cpp, hydro_link.cpp, freefloating_gazebo_control.cpp.
//!
//! Added mass and damping are positive, in the link's axes: `F = -(D_L V + D_Q (V * |V|))` at the centre of buoyancy. Buoyancy is
//! `<compensation>` times the weight of the link. `<density>` multiplies all of them. A thruster pushes along -z of its link,
//! or by `<map>`, the wrench per newton.

use nalgebra::{Matrix6, Vector3};

use super::{link, positive, symmetric, water};
use crate::robot::element::{Element, Result};
use crate::robot::parts::{Robot, RobotThruster};

/// Gravity of the plugin, m/s2.
const GRAVITY: f64 = 9.81;
/// Maximum thrust without `<effort>`, N.
const EFFORT: f64 = 100.0;

/// Reads the hydrodynamics in the links of a URDF file.
pub fn links(document: &Element, robot: &mut Robot) -> Result<()> {
    for (index, element) in document.children("link").enumerate() {
        let path = format!("link \"{}\"", robot.links[index].name);
        blocks(&Element { path, ..element }, index, robot)?;
    }
    Ok(())
}

/// Reads the hydrodynamics in the links of the plugin `freebuoyancy_gazebo`.
pub fn plugin(plugin: &Element, robot: &mut Robot) -> Result<()> {
    for element in plugin.children("link") {
        let name = element.text("name")?;
        if let Some(index) = link(&element, name, robot) {
            blocks(&element, index, robot)?;
        }
    }
    Ok(())
}

/// `<buoyancy>`, of which older files have several in a link, and `<fluid>`.
fn blocks(link: &Element, index: usize, robot: &mut Robot) -> Result<()> {
    for old in link.children("buoyancy") {
        fluid(&old, Some(&old), Some(&old), index, robot)?;
    }
    for new in link.children("fluid") {
        fluid(&new, new.child("buoyancy")?.as_ref(), new.child("hydrodynamics")?.as_ref(), index, robot)?;
    }
    Ok(())
}

fn fluid(
    element: &Element,
    buoyancy: Option<&Element>,
    hydrodynamics: Option<&Element>,
    index: usize,
    robot: &mut Robot,
) -> Result<()> {
    let density = element.positive_value("density")?.unwrap_or(1.0);
    let center = element.origin()?.position;
    let mass = robot.links[index].inertial.as_ref().map_or(0.0, |inertial| inertial.mass);
    let state = water(robot, index);
    if let Some(part) = buoyancy.map(|element| element.at_least_zero_value("compensation")).transpose()?.flatten() {
        let (before, force) = (state.buoyancy.unwrap_or(0.0), GRAVITY * mass * part * density);
        let sum = before + force;
        if sum > 0.0 {
            state.center_of_buoyancy = (state.center_of_buoyancy * before + center * force) / sum;
        }
        state.buoyancy = Some(sum);
    }
    state.frame.position = state.center_of_buoyancy;
    let Some(element) = hydrodynamics else { return Ok(()) };
    if let Some(added) = element.child("added_mass")? {
        let matrix = Matrix6::from_row_slice(&added.listed(36)?) * density;
        state.added_mass = symmetric(positive(&matrix, 1.0, &added, "added mass")?, &added)?;
    }
    for tag in ["damping", "drag"] {
        for part in element.children(tag) {
            let linear = part.node.attribute("type") == Some("linear");
            let mut diagonal = Matrix6::zeros();
            for (attribute, start) in [("xyz", 0), ("rpy", 3)] {
                for (i, x) in part.numbers::<3>(attribute)?.unwrap_or_default().into_iter().enumerate() {
                    diagonal[(start + i, start + i)] = x * density;
                }
            }
            let what = if linear { "linear damping" } else { "quadratic damping" };
            let sum = if linear { &mut state.linear } else { &mut state.quadratic };
            *sum += positive(&diagonal, 1.0, &part, what)?;
        }
    }
    Ok(())
}

/// Reads the thrusters of the control plugin.
pub fn thrusters(plugin: &Element, robot: &mut Robot) -> Result<()> {
    let hull = match plugin.word("link")? {
        Some(name) => link(plugin, name, robot),
        None => Some(0),
    };
    for element in plugin.children("thruster") {
        let effort = element.positive_value("effort")?.unwrap_or(EFFORT);
        let name = element.word("name")?;
        let default = || format!("thr{}", robot.thrusters.len());
        let mut thruster = RobotThruster {
            name: name.map_or_else(default, str::to_owned),
            line: element.line(),
            limits: Some([-effort, effort]),
            ..RobotThruster::default()
        };
        let on = match (element.child("map")?, name) {
            (Some(map), _) => {
                let wrench = map.listed(6)?;
                let force = Vector3::from_row_slice(&wrench[..3]);
                let moment = Vector3::from_row_slice(&wrench[3..]);
                let size = force.norm();
                if size < 1e-9 {
                    map.note("is not read: a moment without a force");
                    continue;
                }
                let along = moment.dot(&force) / size;
                if along.abs() > 1e-6 * moment.norm() {
                    map.note("its moment about the direction of the force is not read");
                }
                thruster.position = force.cross(&moment) / size.powi(2);
                thruster.axis = force / size;
                thruster.limits = Some([-effort * size, effort * size]);
                hull
            }
            (None, Some(name)) => {
                thruster.axis = -Vector3::z();
                link(&element, name, robot)
            }
            (None, None) => {
                element.note("is not read: it has neither <map> nor <name>");
                continue;
            }
        };
        if let Some(index) = on {
            thruster.link = Some(robot.links[index].name.clone());
            robot.thrusters.push(thruster);
        }
    }
    Ok(())
}

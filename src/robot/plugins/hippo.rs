//! Plugins of hippo_simulation: hydrodynamics, buoyancy and thrusters.
//!
//! Sources: hippo_simulation, hippo_gz_plugins/src: hydrodynamics/hydrodynamics.cpp, buoyancy/buoyancy_private.cpp,
//! thruster/thruster_private.cpp.
//!
//! Added mass and linear damping are positive, three numbers each for translation and rotation. Buoyancy is `<compensation>` times
//! the weight of the link. Thrust is `a n^2 + b n + c` at the rotor's speed n in 1/s, the same either way.

use nalgebra::Matrix6;

use super::{link, positive, water};
use crate::robot::element::{Element, Result};
use crate::robot::parts::{Robot, RobotThruster};

/// Gravity of the plugin, m/s2.
const GRAVITY: f64 = 9.81;

/// Reads a plugin of the kind `hydrodynamics`.
pub fn hydrodynamics(plugin: &Element, robot: &mut Robot) -> Result<()> {
    for element in plugin.children("hydrodynamics") {
        let Some(index) = link(&element, element.needed("link")?.content(), robot) else { continue };
        let diagonal = |translation, rotation, what| {
            let (v, w) = (element.values::<3>(translation)?, element.values::<3>(rotation)?);
            let six = v.unwrap_or_default().into_iter().chain(w.unwrap_or_default());
            positive(&Matrix6::from_diagonal(&nalgebra::Vector6::from_iterator(six)), 1.0, &element, what)
        };
        let state = water(robot, index);
        state.added_mass = diagonal("added_mass_linear", "added_mass_angular", "added mass")?;
        state.linear = diagonal("damping_linear", "damping_angular", "linear damping")?;
    }
    Ok(())
}

/// Reads a plugin of the kind `buoyancy`.
pub fn buoyancy(plugin: &Element, robot: &mut Robot) -> Result<()> {
    for element in plugin.children("buoyancy") {
        let Some(index) = link(&element, element.needed("link_name")?.content(), robot) else { continue };
        let mass = robot.links[index].inertial.as_ref().map_or(0.0, |inertial| inertial.mass);
        let part = element.at_least_zero_value("compensation")?.unwrap_or(1.0);
        let center = element.values::<3>("origin")?.unwrap_or_default();
        let state = water(robot, index);
        (state.buoyancy, state.center_of_buoyancy) = (Some(GRAVITY * mass * part), center.into());
    }
    Ok(())
}

/// Reads a plugin of the kind `thruster`.
pub fn thruster(plugin: &Element, robot: &mut Robot) -> Result<()> {
    let number = |tag| Ok(plugin.value(tag)?.unwrap_or(0.0));
    let (speed, a, b, c) =
        (number("maximum_rpm")?, number("quadratic_coeff")?, number("linear_coeff")?, number("constant_coeff")?);
    let n = speed / 60.0;
    let thrust: f64 = a * n * n + b * n + c;
    let (link, joint) = (plugin.word("link")?, plugin.needed("joint")?.content());
    if !robot.joints.iter().any(|other| other.name == joint) {
        plugin.note(&format!("is not read: the file has no joint \"{joint}\""));
        return Ok(());
    }
    robot.thrusters.push(RobotThruster {
        name: link.unwrap_or(joint).to_owned(),
        line: plugin.line(),
        joint: Some(joint.to_owned()),
        limits: (thrust > 0.0).then_some([-thrust, thrust]),
        ..RobotThruster::default()
    });
    Ok(())
}

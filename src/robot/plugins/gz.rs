//! Systems of Gazebo (formerly Ignition): hydrodynamics, thrusters and buoyancy; and Gazebo classic's buoyancy.
//!
//! Sources: gz-sim, src/systems: hydrodynamics/{Hydrodynamics.cc, HydrodynamicsUtils.hh}, thruster/Thruster.cc,
//! buoyancy/Buoyancy.cc; ardupilot_gazebo, src/ArduPilotPlugin.cc; sdformat, sdf/1.11/inertial.sdf (`fluid_added_mass`); Gazebo
//! classic, plugins/BuoyancyPlugin.
//!
//! Coefficients are hydrodynamic derivatives, negative where a wrench opposes the motion, in the link's axes at its origin:
//!
//! ```text
//! F_i = sum_j (A_ij dV_j/dt + (D_ij + sum_k (D_ijk V_k + Q_ijk |V_k|)) V_j)
//! ```
//!
//! with `iDotJ` for A, `iJ` for D, `iJK` for D_ijk and `iJabsK` for Q_ijk; i is one of x y z k m n, J and K one of U V W P Q R.

use nalgebra::{Matrix6, Vector3};

use super::{dissipative, link, positive, symmetric, water};
use crate::robot::element::{Element, Result};
use crate::robot::parts::{Robot, RobotThruster};

/// Forces and moments of SNAME 1950.
const WRENCH: &str = "xyzkmn";
/// Velocities of SNAME 1950.
const TWIST: &str = "UVWPQR";
/// Maximum command without `<max_thrust_cmd>`, N or rad/s. `[Thruster.cc]`
const COMMAND: f64 = 1000.0;

/// Coefficient by the name of its element.
#[derive(Debug, PartialEq)]
enum Derivative {
    /// iDotJ
    Acceleration(usize, usize),
    /// iJ
    Linear(usize, usize),
    /// iJK
    Product(usize, usize, usize),
    /// iJabsK
    Magnitude(usize, usize, usize),
}

impl Derivative {
    fn of(tag: &str) -> Option<Self> {
        let mut letters = tag.chars();
        let i = WRENCH.find(letters.next()?)?;
        let velocity = |text: &str| TWIST.find(text).filter(|_| text.len() == 1);
        let rest = letters.as_str();
        if let Some(j) = rest.strip_prefix("Dot") {
            return Some(Self::Acceleration(i, velocity(j)?));
        }
        if let Some((j, k)) = rest.split_once("abs") {
            return Some(Self::Magnitude(i, velocity(j)?, velocity(k)?));
        }
        let j = velocity(rest.get(..1)?)?;
        match rest.get(1..)? {
            "" => Some(Self::Linear(i, j)),
            k => Some(Self::Product(i, j, velocity(k)?)),
        }
    }
}

/// Reads a system `Hydrodynamics`.
pub fn hydrodynamics(plugin: &Element, robot: &mut Robot) -> Result<()> {
    let name = plugin.needed("link_name")?.content();
    let Some(index) = link(plugin, name, robot) else { return Ok(()) };
    let [mut mass, mut linear, mut quadratic, mut forward] = [Matrix6::zeros(); 4];
    for element in plugin.elements() {
        let tag = element.node.tag_name().name();
        let x = match tag {
            "default_current" => {
                if element.listed(3)?.iter().any(|x| *x != 0.0) {
                    element.note("is not read: set the scene's water.current");
                }
                continue;
            }
            "lookup_current_x" | "lookup_current_y" | "lookup_current_z" => {
                element.note("is not read: set the scene's water.current");
                continue;
            }
            "link_name" | "namespace" | "disable_coriolis" | "disable_added_mass" | "water_density"
            | "waterDensity" => {
                continue;
            }
            _ if Derivative::of(tag).is_some() => element.number_inside()?,
            _ => {
                element.note("is not read: no hydrodynamic derivative");
                continue;
            }
        };
        match Derivative::of(tag) {
            Some(Derivative::Acceleration(i, j)) => mass[(i, j)] = x,
            Some(Derivative::Linear(i, j)) => linear[(i, j)] = x,
            Some(Derivative::Magnitude(i, j, k)) if j == k => quadratic[(i, j)] += x,
            Some(Derivative::Product(i, j, k)) if i == j && j == k => {
                if x != 0.0 {
                    element.note(&format!(
                        "is read as {}abs{}: the plugin's own form adds energy astern",
                        &tag[..2],
                        &tag[2..]
                    ));
                }
                quadratic[(i, j)] += x;
            }
            // u V_j, so a damping by forward speed.
            Some(Derivative::Product(i, j, 0) | Derivative::Product(i, 0, j)) => forward[(i, j)] += x,
            _ if x != 0.0 => element.note("is not read: a scene has no product of these velocities"),
            _ => {}
        }
    }
    let state = water(robot, index);
    state.linear = dissipative(positive(&linear, -1.0, plugin, "linear damping")?, plugin);
    state.quadratic = positive(&quadratic, -1.0, plugin, "quadratic damping")?;
    // Of mixed terms no sign is physical: they lift and turn.
    state.linear_forward_speed = forward.map(|x| 0.0 - x);
    if plugin.flag("disable_added_mass")? != Some(true) && mass != Matrix6::zeros() {
        if state.added_mass != Matrix6::zeros() {
            return plugin.fault("has added mass, but the link has <fluid_added_mass> already: Gazebo would add both");
        }
        state.added_mass = symmetric(positive(&mass, -1.0, plugin, "added mass")?, plugin)?;
    }
    Ok(())
}

/// Added mass `<fluid_added_mass>` of an SDF link: positive, about the link's origin. `[sdformat]`
pub fn fluid_added_mass(element: &Element) -> Result<Matrix6<f64>> {
    let mut mass = Matrix6::zeros();
    for entry in element.elements() {
        let tag = entry.node.tag_name().name();
        let index = |at| tag.get(at..at + 1).and_then(|letter| "xyzpqr".find(letter));
        match (index(0), index(1), tag.len()) {
            (Some(i), Some(k), 2) => {
                mass[(i, k)] = entry.number_inside()?;
                mass[(k, i)] = mass[(i, k)];
            }
            _ => return entry.fault("must be two of the letters x y z p q r"),
        }
    }
    positive(&mass, 1.0, element, "added mass")
}

/// Reads a system `Thruster`: a force along the axis of a joint at the origin of its child, within limits that are thrusts, or
/// with `<use_angvel_cmd>` speeds omega: `T = C_T rho D^4 omega |omega|`.
pub fn thruster(plugin: &Element, robot: &mut Robot) -> Result<()> {
    let name = plugin.needed("joint_name")?.content();
    if !robot.joints.iter().any(|joint| joint.name == name) {
        plugin.note(&format!("is not read: the file has no joint \"{name}\""));
        return Ok(());
    }
    let number = |tag, default: f64| Ok(plugin.value(tag)?.unwrap_or(default));
    let mut commands = [number("min_thrust_cmd", -COMMAND)?, number("max_thrust_cmd", COMMAND)?];
    // The plugin's default of 1000 N, or of limits in the wrong order, is no thruster's.
    let stated = commands[0] < commands[1] && commands != [-COMMAND, COMMAND];
    if plugin.flag("use_angvel_cmd")? == Some(true) {
        let density = number("fluid_density", 1000.0)?;
        let (diameter, coefficient) = (number("propeller_diameter", 0.02)?, number("thrust_coefficient", 1.0)?);
        commands = commands.map(|omega| coefficient * density * diameter.powi(4) * omega * omega.abs());
        commands.sort_by(f64::total_cmp);
    }
    if plugin.child("alpha_2")?.is_some() && plugin.child("thrust_coefficient")?.is_none() {
        plugin.note("<alpha_2>, the loss of thrust by inflow, is not read: see ambient_flow of thrusters");
    }
    robot.thrusters.push(RobotThruster {
        name: name.to_owned(),
        line: plugin.line(),
        joint: Some(name.to_owned()),
        limits: stated.then_some([commands[0].min(0.0), commands[1].max(0.0)]),
        dead_band: plugin.at_least_zero_value("deadband")?,
        ..RobotThruster::default()
    });
    Ok(())
}

/// Reads the limits of thrusters without their own from ArduPilot's channels: commands `multiplier (x + offset)` with x from 0 to 1
/// on the topic `cmd_thrust` of their joints; false if there are none. `[ardupilot_gazebo, ArduPilotPlugin.cc]`
pub fn autopilot(plugin: &Element, robot: &mut Robot) -> Result<bool> {
    let mut read = false;
    for channel in plugin.children("control") {
        let thrust = channel.word("cmd_topic")?.is_some_and(|topic| topic.ends_with("cmd_thrust"));
        let Some(joint) = channel.word("jointName")?.filter(|_| thrust) else { continue };
        let number = |tag, default: f64| Ok(channel.value(tag)?.unwrap_or(default));
        let (multiplier, offset) = (number("multiplier", 1.0)?, number("offset", 0.0)?);
        let mut limits = [offset, 1.0 + offset].map(|x| multiplier * x);
        limits.sort_by(f64::total_cmp);
        let own = robot.thrusters.iter_mut().find(|own| own.joint.as_deref() == Some(joint) && own.limits.is_none());
        if let Some(own) = own.filter(|_| limits[0] <= 0.0 && limits[1] >= 0.0 && limits[0] < limits[1]) {
            (own.limits, read) = (Some(limits), true);
            let [lower, upper] = limits;
            robot.notes.push(format!("{}: limits of {lower} to {upper} N, as ArduPilotPlugin commands it", own.name));
        }
    }
    Ok(read)
}

/// Reads a system `Buoyancy`: the density of the water, and as volume of each link the volume of its collision geometry, where that
/// has no mesh.
pub fn buoyancy(plugin: &Element, robot: &mut Robot) -> Result<()> {
    let graded = plugin.child("graded_buoyancy")?;
    let density = match &graded {
        None => plugin.positive_value("uniform_fluid_density")?,
        Some(graded) => {
            graded.note("layers of density are not read: the robot is under water of the default density");
            graded.positive_value("default_density")?
        }
    };
    robot.fluid_density = Some(density.unwrap_or(1000.0));
    for link in &mut robot.links {
        if !link.shapes.is_empty() && link.meshes.iter().all(|mesh| mesh.visual) {
            let (mut volume, mut moment) = (0.0, Vector3::zeros());
            for shape in &link.shapes {
                let own = shape.solid().map_or(0.0, |solid| shape.displaced_volume(&solid));
                (volume, moment) = (volume + own, moment + shape.position * own);
            }
            let state = link.water.get_or_insert_default();
            (state.volume, state.center_of_buoyancy) = (Some(volume), moment / volume);
        }
    }
    if plugin.child("enable")?.is_some() {
        plugin.note("<enable> is not read: all links displace water");
    }
    Ok(())
}

/// Reads Gazebo classic's `BuoyancyPlugin`: density of the water, and volumes and centres of links.
pub fn classic_buoyancy(plugin: &Element, robot: &mut Robot) -> Result<()> {
    robot.fluid_density = plugin.positive_value("fluid_density")?.or(robot.fluid_density);
    for element in plugin.children("link") {
        let name = element.text("name")?;
        if let Some(index) = link(&element, name, robot) {
            let state = water(robot, index);
            state.volume = element.at_least_zero_value("volume")?;
            state.center_of_buoyancy = Vector3::from(element.values::<3>("center_of_volume")?.unwrap_or_default());
        }
    }
    Ok(())
}

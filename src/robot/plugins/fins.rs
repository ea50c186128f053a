//! Lift of fins: uuv_simulator's fins and Gazebo's lift and drag.
//!
//! Sources: uuv_simulator, uuv_gazebo_plugins/src: FinPlugin.cc, LiftDragModel.cc; gz-sim, src/systems/lift_drag/LiftDrag.cc;
//! Gazebo classic, plugins/LiftDragPlugin.
//!
//! A fin of uuv_simulator has its chord along x and its span along z of its link; the deflection is its joint's coordinate. At
//! the angle of attack alpha and the speed V, with the plugin's own density rho,
//!
//! ```text
//! Quadratic   lift = L alpha V^2,                      drag = D alpha^2 V^2
//! TwoLines    lift = 1/2 rho A V^2 C_La alpha,         drag = 1/2 rho A V^2 C_Da alpha,   to the stall angle
//! ```
//!
//! Here the drag is `k C_L^2`: equal to the first, and equal to the second at the stall angle.

use nalgebra::Vector3;

use super::link;
use crate::description::Fin;
use crate::robot::element::{Element, Result};
use crate::robot::parts::{Robot, RobotFin};

/// Water's density where a block states none, kg/m3.
const WATER: f64 = 1000.0;

/// Reads a fin of uuv_simulator.
pub fn uuv(plugin: &Element, robot: &mut Robot) -> Result<()> {
    let name = plugin.needed("link_name")?.content();
    if link(plugin, name, robot).is_none() {
        return Ok(());
    }
    let lift = plugin.needed("liftdrag")?;
    let mut fin = flat(name, Vector3::x(), Vector3::z());
    match lift.needed("type")?.content() {
        "Quadratic" => {
            let (l, d) = (lift.needed_positive_value("lift_constant")?, lift.at_least_zero_value("drag_constant")?);
            // L = 1/2 rho A a with a = 1, and D = 1/2 rho A k a^2.
            let density = robot.fluid_density.unwrap_or(WATER);
            (fin.area, fin.lift_slope, fin.induced_drag) = (2.0 * l / density, 1.0, d.unwrap_or(0.0) / l);
        }
        "TwoLines" => two_lines(&lift, "fluid_density", &mut fin, robot)?,
        other => return lift.needed("type")?.fault(format!("is \"{other}\", but must be Quadratic or TwoLines")),
    }
    let joint = plugin.word("joint_name")?;
    push(plugin, fin, joint, robot);
    Ok(())
}

/// Reads lift and drag of Gazebo: chord along `<forward>`, lift along `<upward>`, at `<cp>` of the link.
pub fn gazebo(plugin: &Element, robot: &mut Robot) -> Result<()> {
    let name = plugin.needed("link_name")?.content();
    if link(plugin, name, robot).is_none() {
        return Ok(());
    }
    let vector = |tag, default| Ok(plugin.values::<3>(tag)?.map_or(default, Vector3::from));
    let (chord, upward) = (vector("forward", Vector3::x())?, vector("upward", Vector3::z())?);
    let axis = upward.cross(&chord);
    if axis.norm() < 1e-9 {
        return plugin.fault("<forward> and <upward> are parallel, but must be perpendicular");
    }
    let axis = axis.normalize();
    let mut fin = flat(name, axis.cross(&upward).normalize(), axis);
    fin.position = vector("cp", Vector3::zeros())?;
    two_lines(plugin, "air_density", &mut fin, robot)?;
    let above = robot.joints.iter().find(|joint| joint.child == name && joint.moves());
    let joint = above.map(|joint| joint.name.clone());
    push(plugin, fin, joint.as_deref(), robot);
    Ok(())
}

/// A fin without lift, of chord and axis.
fn flat(name: &str, chord: Vector3<f64>, axis: Vector3<f64>) -> Fin {
    Fin {
        name: name.to_owned(),
        position: Vector3::zeros(),
        chord,
        axis,
        area: 0.0,
        lift_slope: 0.0,
        drag: 0.0,
        induced_drag: 0.0,
        stall: None,
        plate: 1.2,
        deflection: 0.0,
        limits: None,
    }
}

/// Coefficients of lift and drag in two straight lines.
fn two_lines(element: &Element, density: &'static str, fin: &mut Fin, robot: &Robot) -> Result<()> {
    let own = element.positive_value(density)?;
    let density = robot.fluid_density.or(own).unwrap_or(WATER);
    fin.area = element.needed_positive_value("area")? * own.unwrap_or(density) / density;
    fin.lift_slope = element.value("cla")?.unwrap_or(1.0).abs();
    let stall = element.value("alpha_stall")?.unwrap_or(std::f64::consts::FRAC_PI_2).abs();
    fin.stall = (0.01..std::f64::consts::FRAC_PI_2).contains(&stall).then_some(stall);
    let drag = element.value("cda")?.unwrap_or(0.0).abs();
    if fin.lift_slope > 0.0 && stall > 0.0 {
        fin.induced_drag = drag / (fin.lift_slope.powi(2) * stall);
    }
    if element.value("a0")?.is_some_and(|angle| angle != 0.0) {
        element.note("<a0>, an angle of the fin without deflection, is not read");
    }
    Ok(())
}

/// Adds the fin; its axis points along its joint's, so that deflections have the joint's sign.
fn push(plugin: &Element, mut fin: Fin, joint: Option<&str>, robot: &mut Robot) {
    let joint = joint.and_then(|name| robot.joints.iter().find(|joint| joint.name == name));
    if joint.is_some_and(|joint| joint.axis.dot(&fin.axis) < 0.0) {
        fin.axis = -fin.axis;
    }
    if plugin.child("dynamics").ok().flatten().is_some() {
        plugin.note("the dynamics of the deflection are not read: it follows its command at once");
    }
    let (link, joint) = (fin.name.clone(), joint.map(|joint| joint.name.clone()));
    robot.fins.push(RobotFin { link, joint, fin });
}

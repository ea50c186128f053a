//! Thrusters of simulators without a reader: their place, and their limits where the names of the elements say them.

use nalgebra::Vector3;

use crate::robot::element::{Element, Result};
use crate::robot::parts::{Robot, RobotThruster};

/// Reads a thruster; false if it names no link or joint of the robot.
pub fn thruster(plugin: &Element, robot: &mut Robot) -> Result<bool> {
    let word = |tags: &[&'static str]| -> Result<Option<&str>> {
        for tag in tags {
            if let Some(word) = plugin.word(tag)? {
                return Ok(Some(word));
            }
        }
        Ok(None)
    };
    let number = |tags: &[&'static str]| -> Result<Option<f64>> {
        for tag in tags {
            if let Some(x) = plugin.value(tag)? {
                return Ok(Some(x));
            }
        }
        Ok(None)
    };
    let joint =
        word(&["jointName", "joint_name", "joint"])?.filter(|name| robot.joints.iter().any(|j| j.name == *name));
    let link = word(&["linkName", "link_name", "link"])?.filter(|name| robot.links.iter().any(|l| l.name == *name));
    let Some(name) = joint.or(link) else { return Ok(false) };
    let above = robot.joints.iter().find(|other| Some(other.child.as_str()) == link && other.moves());
    let joint = joint.or(above.map(|joint| joint.name.as_str()));
    let lower = number(&["minThrust", "min_thrust", "thrustMin", "thrust_min"])?;
    let upper = number(&["maxThrust", "max_thrust", "thrustMax", "thrust_max"])?;
    let limits = upper
        .map(|upper| [lower.unwrap_or(-upper), upper])
        .filter(|[lower, upper]| *lower <= 0.0 && *upper >= 0.0 && lower < upper);
    plugin.note(&format!(
        "a thruster of a simulator that is not known: on {name}, along {}",
        if joint.is_some() { "the axis of its joint" } else { "x of that link" }
    ));
    let thruster = RobotThruster {
        name: name.to_owned(),
        line: plugin.line(),
        link: joint.is_none().then(|| name.to_owned()),
        joint: joint.map(str::to_owned),
        axis: if joint.is_some() { Vector3::zeros() } else { Vector3::x() },
        limits,
        lag: number(&["timeConstant", "time_constant"])?.filter(|lag| *lag > 0.0),
        ..RobotThruster::default()
    };
    robot.thrusters.push(thruster);
    Ok(true)
}

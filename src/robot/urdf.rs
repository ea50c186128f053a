//! Links and joints of a URDF file. `[URDF: wiki.ros.org/urdf/XML]`

use std::cell::RefCell;

use nalgebra::{Matrix3, Vector3};
use roxmltree::{Document, Node};

use super::element::{Element, Result};
use super::plugins;
use super::{Inertial, Mesh, Mimic, Robot, RobotJoint, RobotJointKind, RobotLink};
use crate::estimate::{Axis, Ends, Round, Shape};

/// A robot from a parsed document whose outermost element is `<robot>`.
pub fn read(document: &Document, text: &str, source: &str) -> Result<Robot> {
    let root = document.root_element();
    let lines: Vec<usize> = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n').map(|(at, _)| at).collect();
    let notes = RefCell::default();
    let robot = Element { node: root, path: "<robot>".to_owned(), source, lines: &lines, notes: &notes };
    let is_xacro = |node: Node| node.tag_name().namespace().is_some_and(|space| space.contains("xacro"));
    if let Some(node) = root.descendants().find(|node| is_xacro(*node)) {
        let name = format!("<xacro:{}>", node.tag_name().name());
        return Element { node, path: name, ..robot }.fault("run xacro on the file first");
    }
    let links: Vec<_> = robot.children("link").map(|element| link(&element)).collect::<Result<_>>()?;
    if links.is_empty() {
        return robot.fault("has no <link>: a macro that xacro has to expand?");
    }
    let joints = robot.children("joint").map(|element| joint(&element)).collect::<Result<_>>()?;
    let name = root.attribute("name").unwrap_or_default().to_owned();
    let (source, format) = (source.to_owned(), "URDF".to_owned());
    let mut read = Robot { name, source, format, links, joints, ..Robot::default() };
    plugins::read_urdf(&robot, &mut read)?;
    read.notes.splice(0..0, notes.take());
    Ok(read)
}

fn link(element: &Element) -> Result<RobotLink> {
    let name = element.text("name")?.to_owned();
    let element = &Element { path: format!("link \"{name}\""), ..element.clone() };
    let inertial = element.child("inertial")?.map(|inertial| self::inertial(&inertial)).transpose()?;
    let mut link = RobotLink { name, line: element.line(), inertial, ..RobotLink::default() };
    for tag in ["collision", "visual"] {
        let none = link.shapes.is_empty() && link.meshes.is_empty();
        for part in element.children(tag) {
            match geometry(&part, tag == "visual")? {
                Geometry::Shape(shape) if none => link.shapes.push(shape),
                Geometry::Shape(_) => {}
                Geometry::Mesh(mesh) => link.meshes.push(mesh),
            }
        }
    }
    Ok(link)
}

fn inertial(element: &Element) -> Result<Inertial> {
    let mass = element.needed("mass")?;
    let kg = mass.at_least_zero("value")?.ok_or_else(|| mass.missing("value"))?;
    let inertia = element.needed("inertia")?;
    let entry = |name| inertia.needed_numbers(name);
    let ([xx], [xy], [xz]) = (entry("ixx")?, entry("ixy")?, entry("ixz")?);
    let ([yy], [yz], [zz]) = (entry("iyy")?, entry("iyz")?, entry("izz")?);
    let frame = element.origin()?;
    let inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    Ok(Inertial { mass: kg, position: frame.position, rpy: frame.rpy, inertia })
}

enum Geometry {
    Shape(Shape),
    Mesh(Mesh),
}

/// The geometry of a `<collision>` or `<visual>`.
fn geometry(element: &Element, visual: bool) -> Result<Geometry> {
    let geometry = element.needed("geometry")?;
    let frame = element.origin()?;
    let shape = Shape { position: frame.position, rpy: frame.rpy, ends: Ends::Joined, ..Shape::default() };
    let Some(solid) = geometry.node.children().find(Node::is_element) else {
        return geometry.fault("is empty");
    };
    let tag = solid.tag_name().name();
    let solid = Element { node: solid, path: format!("{} <{tag}>", geometry.path), ..geometry };
    let round = || Ok(Round { radius: solid.positive("radius")?, length: solid.positive("length")?, axis: Axis::Z });
    Ok(Geometry::Shape(match tag {
        "box" => {
            let size = solid.needed_numbers::<3>("size")?;
            if let Some(edge) = size.iter().find(|edge| **edge <= 0.0) {
                return solid.fault(format!("size has {edge}, but edges must be > 0"));
            }
            Shape { cuboid: Some(size.into()), ..shape }
        }
        "cylinder" => Shape { cylinder: Some(round()?), ..shape },
        "capsule" => Shape { capsule: Some(round()?), ends: Ends::Free, ..shape },
        "sphere" => Shape { ellipsoid: Some(Vector3::repeat(solid.positive("radius")?)), ..shape },
        "mesh" => {
            let (file, scale) = (solid.text("filename")?.to_owned(), solid.numbers::<3>("scale")?.unwrap_or([1.0; 3]));
            let (position, rpy) = (frame.position, frame.rpy);
            return Ok(Geometry::Mesh(Mesh { file, scale: scale.into(), position, rpy, visual, ..Mesh::default() }));
        }
        _ => return solid.fault("must be one of box, cylinder, capsule, sphere, mesh"),
    }))
}

fn joint(element: &Element) -> Result<RobotJoint> {
    let name = element.text("name")?.to_owned();
    let element = &Element { path: format!("joint \"{name}\""), ..element.clone() };
    let mut kind = match element.text("type")? {
        "fixed" => RobotJointKind::Fixed,
        "revolute" => RobotJointKind::Revolute,
        "continuous" => RobotJointKind::Continuous,
        "prismatic" => RobotJointKind::Prismatic,
        "floating" => RobotJointKind::Floating,
        other => {
            return element
                .fault(format!("type is \"{other}\", but must be revolute, continuous, prismatic, fixed or floating"));
        }
    };
    let end = |tag| Ok(element.needed(tag)?.text("link")?.to_owned());
    let mut joint = RobotJoint { parent: end("parent")?, child: end("child")?, ..RobotJoint::default() };
    let turns = !matches!(kind, RobotJointKind::Fixed | RobotJointKind::Floating);
    joint.axis = match element.child("axis")?.filter(|_| turns) {
        None => Vector3::x(),
        Some(axis) => {
            let vector = Vector3::from(axis.needed_numbers::<3>("xyz")?);
            if vector.norm() < 1e-9 {
                return axis.fault("xyz must have a nonzero length");
            }
            vector
        }
    };
    let limited = matches!(kind, RobotJointKind::Revolute | RobotJointKind::Prismatic);
    if let Some(limit) = &element.child("limit")? {
        // Zero means "unknown" in most files: a motor without torque is not a motor.
        let maximum = |name| Ok(limit.bound(name)?.map(|_| limit.at_least_zero(name)).transpose()?.flatten());
        joint.effort = maximum("effort")?.filter(|x| *x > 0.0);
        joint.speed = maximum("velocity")?.filter(|x| *x > 0.0);
        let absent = |name| limit.node.attribute(name).is_none();
        let end = |name| Ok(if absent(name) { Some(0.0) } else { limit.bound(name)? });
        if let (true, Some(lower), Some(upper)) = (limited, end("lower")?, end("upper")?) {
            if lower > upper {
                return limit.fault(format!("lower is {lower}, but must be below upper, {upper}"));
            }
            joint.limits = Some([lower, upper]);
        } else if kind == RobotJointKind::Revolute {
            kind = RobotJointKind::Continuous;
        }
    } else if limited {
        return element.fault("<limit> is missing, which revolute and prismatic joints need");
    }
    let dynamics = element.child("dynamics")?;
    let dynamics = |name| Ok(dynamics.as_ref().map(|d| d.at_least_zero(name)).transpose()?.flatten().unwrap_or(0.0));
    (joint.damping, joint.friction, joint.armature) =
        (dynamics("damping")?, dynamics("friction")?, dynamics("armature")?);
    joint.mimic = element.child("mimic")?.map(|mimic| self::mimic(&mimic)).transpose()?;
    let frame = element.origin()?;
    Ok(RobotJoint { name, line: element.line(), kind, position: frame.position, rpy: frame.rpy, ..joint })
}

fn mimic(element: &Element) -> Result<Mimic> {
    let number = |name, default| Ok(element.number(name)?.unwrap_or(default));
    Ok(Mimic {
        joint: element.text("joint")?.to_owned(),
        multiplier: number("multiplier", 1.0)?,
        offset: number("offset", 0.0)?,
    })
}

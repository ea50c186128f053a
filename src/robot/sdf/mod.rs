//! A vehicle or arm of an SDF file: one model, alone or in a world. `[SDF: sdformat.org/spec, 1.4 to 1.11]`
//!
//! Link poses are in the model's frame unless `relative_to` names another; joint poses are in the child's frame. A joint of this
//! project lies at the origin of its child link, so a link whose joint has a pose is moved to it: its body and its geometry
//! stay where they are. Axes are in the joint's frame; in the model's frame up to version 1.4, with `use_parent_model_frame`,
//! or in the frame that `expressed_in` names.

mod bodies;
mod frames;

use std::cell::RefCell;
use std::collections::HashMap;

use nalgebra::Vector3;
use roxmltree::Document;

use super::element::{Element, Result};
use super::merge::compose;
use super::plugins;
use super::{Mimic, Robot, RobotJoint, RobotJointKind, RobotLink};
use crate::description::Frame;
use bodies::link;
use frames::{Poses, relative};

/// Limits of this magnitude, rad or m, stand for none.
const UNLIMITED: f64 = 1e6;
/// Parent of joints that fix a link in the world.
const WORLD: &str = "world";

/// A robot from a parsed document whose outermost element is `<sdf>`.
pub fn read(document: &Document, text: &str, source: &str) -> Result<Robot> {
    let lines: Vec<usize> = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n').map(|(at, _)| at).collect();
    let notes = RefCell::default();
    let node = document.root_element();
    let mut robot = file(&Element { node, path: "<sdf>".to_owned(), source, lines: &lines, notes: &notes })?;
    robot.notes.splice(0..0, notes.take());
    Ok(robot)
}

fn file(sdf: &Element) -> Result<Robot> {
    // Version 1.10 comes after 1.9.
    let minor = sdf.node.attribute("version").and_then(|text| text.split('.').nth(1)?.parse().ok()).unwrap_or(4);
    let world = sdf.child("world")?;
    let holder = world.as_ref().unwrap_or(sdf);
    let model = model(holder)?;
    let name = model.node.attribute("name").unwrap_or_default().to_owned();
    let model = Element { path: format!("model \"{name}\""), ..model };
    let mut robot = Robot { name, source: sdf.source.to_owned(), format: "SDF".to_owned(), ..Robot::default() };
    if let Some(nested) = model.children("model").next() {
        return nested.fault("models in models are not read: make their links and joints this model's own");
    }
    if let Some(include) = model.children("include").next() {
        let file = include.word("uri")?.unwrap_or_default().to_owned();
        return include.fault(format!("\"{file}\" is not read: put its links and joints here, as `gz sdf -p` does"));
    }
    let poses = Poses::read(&model)?;
    let links: Vec<_> = model.children("link").collect();
    if links.is_empty() {
        return model.fault("has no <link>");
    }
    for element in &links {
        robot.links.push(link(element, &mut robot.notes)?);
    }
    // Frames of the links in the model: where the file puts them, and where their joints are.
    let own: HashMap<String, Frame> =
        robot.links.iter().map(|l| Ok((l.name.clone(), poses.of(&l.name, sdf)?))).collect::<Result<_>>()?;
    let mut moved = own.clone();
    let mut joints = Vec::new();
    for element in model.children("joint") {
        if let Some((joint, at)) = joint(&element, minor, &poses)? {
            if joint.moves() {
                moved.insert(joint.child.clone(), at);
            }
            joints.push(joint);
        }
    }
    for joint in &mut joints {
        let child = &moved[&joint.child];
        let frame = match moved.get(&joint.parent) {
            Some(parent) => relative(parent, child),
            None => child.clone(),
        };
        (joint.position, joint.rpy) = (frame.position, frame.rpy);
    }
    if joints.iter().any(|joint| joint.parent == WORLD) {
        robot.links.push(RobotLink { name: WORLD.to_owned(), ..RobotLink::default() });
    }
    robot.joints = joints;
    let parents: Vec<&Element> = [&model].into_iter().chain(&world).collect();
    plugins::read_sdf(&parents, &mut robot)?;
    for (link, own) in &own {
        if own != &moved[link] {
            shift(&mut robot, link, &relative(&moved[link], own));
        }
    }
    Ok(robot)
}

/// The only model that can move, or the only one with hydrodynamics or thrusters.
fn model<'a>(holder: &Element<'a>) -> Result<Element<'a>> {
    let name = |model: &Element| model.node.attribute("name").unwrap_or_default().to_owned();
    let all: Vec<_> = holder.children("model").collect();
    let mut free = Vec::new();
    for model in &all {
        if all.len() > 1 && model.flag("static")? == Some(true) {
            model.note(&format!("\"{}\" is static: not read", name(model)));
        } else {
            free.push(model.clone());
        }
    }
    let vehicles: Vec<_> = free.iter().filter(|model| plugins::describe_vehicle(model)).cloned().collect();
    if let ([vehicle], true) = (&vehicles[..], free.len() > 1) {
        let others: Vec<_> = free.iter().map(name).filter(|other| *other != name(vehicle)).collect();
        holder.note(&format!("models without hydrodynamics or thrusters are not read: {}", others.join(", ")));
        free = vehicles;
    }
    let includes: Vec<_> =
        holder.children("include").filter_map(|include| include.word("uri").ok().flatten()).collect();
    match free.len() {
        1 => {
            if !includes.is_empty() {
                holder.note(&format!("<include> of {}: not read", includes.join(", ")));
            }
            Ok(free.remove(0))
        }
        0 if includes.is_empty() => holder.fault("has no <model>"),
        0 => {
            holder.fault(format!("has no <model>, but includes {}: import the file of the model", includes.join(", ")))
        }
        _ => {
            let names: Vec<_> = free.iter().map(name).collect();
            holder.fault(format!("has several models ({}), but one is read: remove the others", names.join(", ")))
        }
    }
}

/// Expresses a link's content, given in a frame `at` of the link, in the link's frame.
fn shift(robot: &mut Robot, name: &str, at: &Frame) {
    let place = |position: &mut Vector3<f64>, rpy: &mut Vector3<f64>| {
        let frame = compose(at, &Frame { position: *position, rpy: *rpy });
        (*position, *rpy) = (frame.position, frame.rpy);
    };
    for link in robot.links.iter_mut().filter(|link| link.name == name) {
        link.inertial.iter_mut().for_each(|part| place(&mut part.position, &mut part.rpy));
        link.shapes.iter_mut().for_each(|part| place(&mut part.position, &mut part.rpy));
        link.meshes.iter_mut().for_each(|part| place(&mut part.position, &mut part.rpy));
        if let Some(water) = &mut link.water {
            place(&mut water.frame.position, &mut water.frame.rpy);
            place(&mut water.center_of_buoyancy, &mut Vector3::zeros());
        }
    }
    let joints = &robot.joints;
    let carries = |joint: &String| joints.iter().any(|other| other.name == *joint && other.child == name);
    for thruster in &mut robot.thrusters {
        if thruster.link.as_deref() == Some(name) || thruster.joint.as_ref().is_some_and(carries) {
            place(&mut thruster.position, &mut Vector3::zeros());
            thruster.axis = at.rotation() * thruster.axis;
        }
    }
}

/// A joint, and its frame in the model; None for a constraint between other joints.
fn joint(element: &Element, minor: u32, poses: &Poses) -> Result<Option<(RobotJoint, Frame)>> {
    let name = element.text("name")?.to_owned();
    let element = &Element { path: format!("joint \"{name}\""), ..element.clone() };
    let end = |tag| {
        let end = element.needed(tag)?;
        let name = end.content();
        if tag == "parent" && name == WORLD { Ok(WORLD.to_owned()) } else { poses.link(name, &end) }
    };
    let kind = element.text("type")?;
    if kind == "gearbox" {
        element.note("a gearbox is not read");
        return Ok(None);
    }
    let (parent, child) = (end("parent")?, end("child")?);
    let at = poses.of(&name, element)?;
    let mut joint = RobotJoint { name, line: element.line(), parent, child, ..RobotJoint::default() };
    joint.kind = match kind {
        "fixed" => RobotJointKind::Fixed,
        "revolute" => RobotJointKind::Revolute,
        "continuous" => RobotJointKind::Continuous,
        "prismatic" => RobotJointKind::Prismatic,
        "ball" | "universal" | "screw" | "revolute2" => {
            element.note(&format!("a {kind} joint is not read: locked at 0"));
            RobotJointKind::Fixed
        }
        other => {
            let rule =
                "but must be revolute, continuous, prismatic or fixed; ball, universal, screw and revolute2 are locked";
            return element.fault(format!("type is \"{other}\", {rule}"));
        }
    };
    if joint.moves() {
        let axis = element.child("axis")?;
        joint.axis = Vector3::z();
        if let Some(axis) = &axis {
            joint.axis = self::axis(axis, minor, poses, &at)?;
            limits(axis, &mut joint)?;
        }
        if joint.kind == RobotJointKind::Revolute && joint.limits.is_none() {
            joint.kind = RobotJointKind::Continuous;
        }
    }
    Ok(Some((joint, at)))
}

/// The axis in the joint's frame `at`.
fn axis(element: &Element, minor: u32, poses: &Poses, at: &Frame) -> Result<Vector3<f64>> {
    let Some(xyz) = element.child("xyz")? else { return Ok(Vector3::z()) };
    let vector = Vector3::from_row_slice(&xyz.listed(3)?);
    if vector.norm() < 1e-9 {
        return xyz.fault("must have a nonzero length");
    }
    let in_model = element.flag("use_parent_model_frame")?.unwrap_or(minor <= 4);
    let base = match xyz.node.attribute("expressed_in").filter(|name| !name.is_empty()) {
        Some(name) => Some(poses.of(name, &xyz)?),
        None => in_model.then(Frame::default),
    };
    Ok(match base {
        Some(base) if base.rpy != at.rpy => at.rotation().transpose() * (base.rotation() * vector),
        _ => vector,
    })
}

/// Limits, friction and `<mimic>` of an axis.
fn limits(axis: &Element, joint: &mut RobotJoint) -> Result<()> {
    if let Some(limit) = axis.child("limit")? {
        let number = |tag, default: f64| -> Result<f64> {
            let Some(child) = limit.child(tag)? else { return Ok(default) };
            match child.content().parse::<f64>() {
                Ok(x) if !x.is_nan() => Ok(x),
                _ => child.fault(format!("\"{}\" is not a number", child.content())),
            }
        };
        let (lower, upper) = (number("lower", f64::NEG_INFINITY)?, number("upper", f64::INFINITY)?);
        if lower > upper {
            return limit.fault(format!("lower is {lower}, but must be below upper, {upper}"));
        }
        let bounded = lower > -UNLIMITED && upper < UNLIMITED;
        joint.limits = (bounded && joint.kind != RobotJointKind::Continuous).then_some([lower, upper]);
        let finite = |x: f64| (x > 0.0 && x < UNLIMITED).then_some(x);
        joint.effort = finite(number("effort", -1.0)?);
        joint.speed = finite(number("velocity", -1.0)?);
    }
    if let Some(dynamics) = axis.child("dynamics")? {
        joint.damping = dynamics.at_least_zero_value("damping")?.unwrap_or(0.0);
        joint.friction = dynamics.at_least_zero_value("friction")?.unwrap_or(0.0);
        joint.stiffness = dynamics.at_least_zero_value("spring_stiffness")?.unwrap_or(0.0);
        joint.spring_rest = dynamics.value("spring_reference")?.unwrap_or(0.0);
    }
    if let Some(mimic) = axis.child("mimic")? {
        let number = |tag, default| Ok(mimic.value(tag)?.unwrap_or(default));
        let (multiplier, offset, reference) =
            (number("multiplier", 1.0)?, number("offset", 0.0)?, number("reference", 0.0)?);
        let joint_name = mimic.text("joint")?.to_owned();
        joint.mimic = Some(Mimic { joint: joint_name, multiplier, offset: offset - multiplier * reference });
    }
    Ok(())
}

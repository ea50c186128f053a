//! Poses of an SDF model: links, joints and named frames.

use std::collections::HashMap;

use nalgebra::{UnitQuaternion, Vector3};

use crate::description::Frame;
use crate::robot::element::{Element, Result};
use crate::robot::merge::{angles, compose};

/// Name of the model's own frame.
const MODEL: &str = "__model__";

/// Named frames of a model.
pub struct Poses<'a> {
    /// Pose, and the frame that it is relative to.
    frames: HashMap<&'a str, (Frame, &'a str)>,
    /// Link that carries each frame.
    carrier: HashMap<&'a str, &'a str>,
}

impl<'a> Poses<'a> {
    /// Reads the poses of all links, joints and frames.
    pub fn read(model: &Element<'a>) -> Result<Self> {
        let (mut frames, mut carrier) = (HashMap::new(), HashMap::new());
        for tag in ["link", "joint", "frame"] {
            for element in model.children(tag) {
                let name = element.text("name")?;
                let child = if tag == "joint" { element.word("child")? } else { None };
                let attached = element.node.attribute("attached_to").filter(|to| !to.is_empty());
                let (pose, stated) = pose(&element)?;
                let base = stated.or(child).or(attached).unwrap_or(MODEL);
                if frames.insert(name, (pose, base)).is_some() {
                    return element.fault(format!("the name \"{name}\" is taken by an earlier link, joint or frame"));
                }
                let first = || model.children("link").next().and_then(|link| link.node.attribute("name"));
                let on = if tag == "link" { Some(name) } else { child.or(attached).or_else(first) };
                on.into_iter().for_each(|on| {
                    carrier.insert(name, on);
                });
            }
        }
        Ok(Self { frames, carrier })
    }

    /// A named frame in the model's frame.
    pub fn of(&self, name: &str, place: &Element) -> Result<Frame> {
        let (mut at, mut frame, mut left) = (name, Frame::default(), self.frames.len() + 1);
        while at != MODEL {
            let Some((pose, base)) = self.frames.get(at) else {
                return place.fault(format!("no link, joint or frame is called \"{at}\""));
            };
            left -= 1;
            if left == 0 {
                return place.fault(format!("the pose of \"{name}\" is relative to itself"));
            }
            frame = compose(pose, &frame);
            at = base;
        }
        Ok(frame)
    }

    /// Name of the link that carries a link or frame.
    pub fn link(&self, name: &str, place: &Element) -> Result<String> {
        let mut at = name;
        for _ in 0..=self.carrier.len() {
            match self.carrier.get(at) {
                Some(on) if *on == at => return Ok(at.to_owned()),
                Some(on) => at = on,
                None => break,
            }
        }
        place.fault(format!("unknown link \"{name}\""))
    }
}

/// Pose of an element, and the frame that it is relative to, if it states one.
fn pose<'a>(element: &Element<'a>) -> Result<(Frame, Option<&'a str>)> {
    let Some(pose) = element.child("pose")? else { return Ok((Frame::default(), None)) };
    let attribute = |name| pose.node.attribute(name).filter(|text| !text.is_empty());
    let base = attribute("relative_to").or(attribute("frame"));
    if pose.content().is_empty() {
        return Ok((Frame::default(), base));
    }
    if attribute("rotation_format") == Some("quat_xyzw") {
        let n = pose.listed(7)?;
        let quaternion = nalgebra::Quaternion::new(n[6], n[3], n[4], n[5]);
        if quaternion.norm() < 1e-9 {
            return pose.fault("its quaternion is 0");
        }
        let turn = UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix();
        return Ok((Frame { position: Vector3::new(n[0], n[1], n[2]), rpy: angles(turn.matrix()) }, base));
    }
    let n = pose.listed(6)?;
    let degrees = matches!(attribute("degrees"), Some("true" | "1"));
    let unit = if degrees { std::f64::consts::PI / 180.0 } else { 1.0 };
    Ok((Frame { position: Vector3::new(n[0], n[1], n[2]), rpy: Vector3::new(n[3], n[4], n[5]) * unit }, base))
}

/// Pose of an element that has no frame but its parent's.
pub fn local(element: &Element) -> Result<Frame> {
    let (frame, base) = pose(element)?;
    match base {
        None => Ok(frame),
        Some(base) => {
            element.needed("pose")?.fault(format!("relative_to=\"{base}\" is read for links, joints and frames alone"))
        }
    }
}

/// `inner` in the frame `outer`, both in the same frame. Frames of the same rotation differ by none.
pub fn relative(outer: &Frame, inner: &Frame) -> Frame {
    let back = outer.rotation().transpose();
    let offset = inner.position - outer.position;
    let position = if outer.rpy == Vector3::zeros() { offset } else { back * offset };
    let rpy = if outer.rpy == inner.rpy {
        Vector3::zeros()
    } else if outer.rpy == Vector3::zeros() {
        inner.rpy
    } else {
        angles(&(back * inner.rotation()))
    };
    Frame { position, rpy }
}

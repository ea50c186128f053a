//! Moving parts: links that are rigidly connected.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

use super::check::{Impossible, impossible};
use super::element::Result;
use super::tree::Tree;
use super::{Inertial, RobotJoint, RobotJointKind};
use crate::description::{Frame, MeshFile};

/// A moving part, in the frame of its first link.
pub struct Part {
    /// Joint that carries it; none of the root.
    pub joint: Option<usize>,
    /// Part that carries it; of the root itself.
    pub carrier: usize,
    /// Frame of the joint in the carrier's frame.
    pub frame: Frame,
    /// Links with their frames in the part's frame; the first one's is the identity.
    pub links: Vec<(usize, Frame)>,
}

impl Part {
    /// Mesh files that draw the part, in its frame.
    pub fn mesh_files(&self, tree: &Tree) -> Vec<MeshFile> {
        let of = |(link, at): &(usize, Frame)| {
            let files = tree.robot.links[*link].meshes.iter().filter_map(|mesh| mesh.drawing.as_ref());
            files.map(|file| file.at(compose(at, &file.frame()))).collect::<Vec<_>>()
        };
        self.links.iter().flat_map(of).collect()
    }
}

/// Inertial properties of a part in its frame.
#[derive(Debug, Clone, Default)]
pub struct Rigid {
    pub mass: f64,
    pub center_of_mass: Vector3<f64>,
    /// About the centre of mass.
    pub inertia: Matrix3<f64>,
}

/// The pose of `inner` in the parent of `outer`. Composition with a pose without rotation is exact.
pub fn compose(outer: &Frame, inner: &Frame) -> Frame {
    let rotation = outer.rotation();
    let position = if *outer == Frame::default() { inner.position } else { outer.position + rotation * inner.position };
    let rpy = if outer.rpy == Vector3::zeros() {
        inner.rpy
    } else if inner.rpy == Vector3::zeros() {
        outer.rpy
    } else {
        angles(&(rotation * inner.rotation()))
    };
    Frame { position, rpy }
}

/// Roll, pitch and yaw of a rotation, accurate to rounding also near pitches of 90 degrees, where roll and yaw turn about nearly the
/// same axis: the roll is the rotation that remains after yaw.
pub fn angles(r: &Matrix3<f64>) -> Vector3<f64> {
    let yaw = r[(1, 0)].atan2(r[(0, 0)]);
    let pitch = (-r[(2, 0)]).atan2(r[(0, 0)].hypot(r[(1, 0)]));
    let (sin, cos) = yaw.sin_cos();
    let roll = (sin * r[(0, 2)] - cos * r[(1, 2)]).atan2(cos * r[(1, 1)] - sin * r[(0, 1)]);
    Vector3::new(roll, pitch, yaw)
}

/// The child's frame in the parent's at coordinate `at` of the joint.
fn displaced(joint: &RobotJoint, at: f64) -> Frame {
    let frame = joint.frame();
    if at == 0.0 || joint.kind == RobotJointKind::Fixed {
        return frame;
    }
    let axis = joint.axis.normalize();
    let motion = if joint.kind == RobotJointKind::Prismatic {
        Frame { position: axis * at, rpy: Vector3::zeros() }
    } else {
        let turn = Rotation3::from_axis_angle(&Unit::new_unchecked(axis), at);
        Frame { position: Vector3::zeros(), rpy: angles(turn.matrix()) }
    };
    compose(&frame, &motion)
}

/// Parts below and including the root's, each after its carrier; `frozen` has the coordinate of each joint that does not move.
pub fn parts(tree: &Tree, root: usize, frozen: &[Option<f64>]) -> Vec<Part> {
    let mut parts: Vec<Part> = Vec::new();
    // Link, its frame, the part before it, and the joint where that part ends.
    let mut open = vec![(root, Frame::default(), 0, None)];
    while let Some((link, frame, part, joint)) = open.pop() {
        let (part, frame) = if joint.is_some() || parts.is_empty() {
            parts.push(Part { joint, carrier: part, frame, links: Vec::new() });
            (parts.len() - 1, Frame::default())
        } else {
            (part, frame)
        };
        for (j, joint) in tree.joints_of(link).collect::<Vec<_>>().into_iter().rev() {
            let moving = if frozen[j].is_none() { Some(j) } else { None };
            let beyond = compose(&frame, &displaced(joint, frozen[j].unwrap_or(0.0)));
            open.push((tree.child[j], beyond, part, moving));
        }
        parts[part].links.push((link, frame));
    }
    parts
}

/// Inertial properties of a part. Point masses, and links whose own moments no body has, count where the sum is a body's; else
/// moments that break the triangle inequality are replaced by the nearest ones that do not.
///
/// # Errors
/// Moments that are not positive.
pub fn rigid(tree: &Tree, part: &Part, inertials: &[Option<Inertial>], notes: &mut Vec<String>) -> Result<Rigid> {
    let owns = |near: bool| {
        let mut sum = Rigid::default();
        for (link, at) in &part.links {
            let Some(own) = inertials[*link].as_ref().filter(|own| own.mass > 0.0) else { continue };
            match impossible(&own.inertia) {
                Some(Impossible::Triangle(_, inertia)) if near => sum.add(&Inertial { inertia, ..own.clone() }, at),
                _ => sum.add(own, at),
            }
        }
        sum
    };
    let sum = owns(false);
    let whole = impossible(&sum.inertia).is_some();
    for (link, _) in &part.links {
        let own = inertials[*link].as_ref().filter(|own| own.mass > 0.0 && !own.is_point());
        let Some(problem) = own.and_then(|own| impossible(&own.inertia)) else { continue };
        let link = &tree.robot.links[*link];
        let line = if link.line > 0 { format!(" (line {})", link.line) } else { String::new() };
        match problem {
            Impossible::Negative(moments) if whole => {
                let place = format!("link \"{}\" <inertial> <inertia>", link.name);
                return tree.robot.fault(link.line, &place, format!("principal moments are {moments}, but must be > 0"));
            }
            Impossible::Triangle(moments, _) if whole => notes.push(format!(
                "{}{line}: of its principal moments {moments} the largest exceeds the sum of the others, as of no body: the nearest ones that a body has",
                link.name
            )),
            Impossible::Negative(moments) | Impossible::Triangle(moments, _) => notes.push(format!(
                "{}{line}: principal moments {moments} are no body's; with the links fixed to it they are",
                link.name
            )),
        }
    }
    Ok(if whole { owns(true) } else { sum })
}

impl Rigid {
    fn add(&mut self, own: &Inertial, at: &Frame) {
        let frame = compose(at, &own.frame());
        let inertia = if frame.rpy == Vector3::zeros() {
            own.inertia
        } else {
            let turned = frame.rotation() * own.inertia * frame.rotation().transpose();
            (turned + turned.transpose()) / 2.0
        };
        if self.mass == 0.0 {
            *self = Self { mass: own.mass, center_of_mass: frame.position, inertia };
            return;
        }
        let total = self.mass + own.mass;
        let offset = (frame.position - self.center_of_mass).cross_matrix();
        self.inertia += inertia - offset * offset * (self.mass * own.mass / total);
        self.center_of_mass = (self.center_of_mass * self.mass + frame.position * own.mass) / total;
        self.mass = total;
    }
}

//! Joint frames of the kernel.
//!
//! Every chain of revolute and prismatic joints can be written in modified Denavit-Hartenberg frames: z along the joint, x along
//! the common normal to the axis of the first joint on its link; further joints have a constant turn and offset about z before it. Between nearly parallel axes, whose common normal is far away
//! and ill conditioned, the constant transform stays a general pose.

use nalgebra as na;

use crate::description::Frame;
use crate::lie::{Matrix3, Pose, Vector3};
use crate::spatial::LinkTwist;

use super::model::{Before, JointPlacement};

/// Axis line of a joint at q = 0, in the vehicle frame.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    /// Joint whose link carries this one; none for the vehicle.
    pub carrier: Option<usize>,
    /// A point on the axis.
    pub point: Vector3<f64>,
    /// Unit direction.
    pub direction: Vector3<f64>,
    /// The link's axes, as columns.
    pub axes: Matrix3<f64>,
}

/// A joint frame and its transform from the parent.
#[derive(Debug, Clone, Copy)]
pub struct JointFrame {
    /// Pose in the vehicle frame at q = 0.
    pub pose: Pose<f64>,
    /// Constant transform from the carrier's joint frame, or from the vehicle's frame.
    pub placement: JointPlacement<f64>,
    /// theta at q = 0, rad.
    pub theta: f64,
    /// d at q = 0, m.
    pub d: f64,
}

/// Sine of the angle between two axes below which they count as parallel.
const PARALLEL: f64 = 1e-14;
/// Sine of the angle below which the common normal of two axes is ill conditioned.
const NEARLY_PARALLEL: f64 = 0.05;

/// Lengths, m, and entries of rotations below this are rounding.
const ROUNDING: f64 = 1e-15;

/// The length, unless it is rounding.
pub fn nonzero(length: f64) -> Option<f64> {
    (length.abs() > ROUNDING).then_some(length)
}

/// Common normal of two lines: its feet, its direction from the first line, and the angle between the lines.
struct Normal {
    feet: [Vector3<f64>; 2],
    direction: Vector3<f64>,
    sin: f64,
    cos: f64,
}

impl Normal {
    /// Signed distance of the lines along the normal.
    fn length(&self) -> f64 {
        (self.feet[1] - self.feet[0]).dot(self.direction)
    }
}

/// Joint frames of a tree, carriers first.
pub fn joint_frames(lines: &[Line]) -> Vec<JointFrame> {
    // The first joint on each link, and the common normal of both axes.
    let child = |i: usize| lines.iter().position(|line| line.carrier == Some(i));
    let normals: Vec<Option<Normal>> =
        lines.iter().enumerate().map(|(i, line)| common_normal(*line, lines[child(i)?])).collect();
    let mut frames: Vec<JointFrame> = Vec::with_capacity(lines.len());
    for (i, line) in lines.iter().enumerate() {
        // The carrier, if this is the first joint on it.
        let before = line.carrier.filter(|&k| child(k) == Some(i));
        let pose = match &normals[i] {
            Some(normal) => frame(normal.feet[0], normal.direction, line.direction),
            None => {
                // The origin is free along the axis: at the foot of the normal with the joint before, d is 0. The direction of x
                // is free: along the link's own axes, in which its coefficients are given.
                let before = before.and_then(|k| normals[k].as_ref());
                let point = before.map_or(line.point, |normal| normal.feet[1]);
                frame(point, perpendicular(line.direction, line.axes), line.direction)
            }
        };
        let next = match (before, line.carrier) {
            (Some(parent), _) => match &normals[parent] {
                Some(normal) => by_normal(normal, *line, pose, None),
                None => by_pose(&inverse(&frames[parent].pose).times(&pose), pose),
            },
            (None, None) => by_z_axis(*line, pose),
            (None, Some(carrier)) => {
                let carrier = inverse(&frames[carrier].pose);
                let (point, direction) = (carrier.rotation.apply(line.point) + carrier.position, line.direction);
                let direction = carrier.rotation.apply(direction);
                JointFrame { pose, ..by_z_axis(Line { point, direction, ..*line }, carrier.times(&pose)) }
            }
        };
        frames.push(next);
    }
    frames
}

/// A joint's frame, related to the carrier's, in whose coordinates line and pose are given, by the common normal of their z axes if
/// there is one.
fn by_z_axis(line: Line, pose: Pose<f64>) -> JointFrame {
    let vertical = Line { point: Vector3([0.0; 3]), direction: Vector3([0.0, 0.0, 1.0]), ..line };
    let Some(normal) = common_normal(vertical, line) else { return by_pose(&pose, pose) };
    // Without the rounding of a direction along x or y.
    let [cos, sin] = [0, 1].map(|k| normal.direction.0[k]).map(|x| if x.abs() < PARALLEL { 0.0 } else { x });
    let turn = if sin == 0.0 && cos > 0.0 { LinkTwist::Deg0 } else { LinkTwist::General(sin, cos) };
    let d = nonzero(normal.feet[0].0[2]);
    let before = (turn != LinkTwist::Deg0 || d.is_some()).then_some(Before::Screw(turn, d));
    by_normal(&normal, line, pose, before)
}

/// A frame related to its parent by a common normal, after another transform if there is one, and a screw about its own z axis.
fn by_normal(normal: &Normal, line: Line, pose: Pose<f64>, before: Option<Before<f64>>) -> JointFrame {
    let x = Vector3(pose.rotation.transposed().0[0]);
    let (twist, a) = (link_twist(normal.sin, normal.cos), nonzero(normal.length()));
    JointFrame {
        pose,
        placement: JointPlacement { before, twist, a },
        theta: normal.direction.cross(x).dot(line.direction).atan2(normal.direction.dot(x)),
        d: (pose.position - normal.feet[1]).dot(line.direction),
    }
}

/// A frame related to its parent by a general pose.
fn by_pose(relative: &Pose<f64>, pose: Pose<f64>) -> JointFrame {
    JointFrame {
        pose,
        placement: JointPlacement {
            before: Some(Before::Pose(relative.rotation.0, relative.position.0)),
            twist: LinkTwist::Deg0,
            a: None,
        },
        theta: 0.0,
        d: 0.0,
    }
}

/// `T^-1`
pub fn inverse(pose: &Pose<f64>) -> Pose<f64> {
    let rotation = pose.rotation.transposed();
    Pose { rotation, position: -rotation.apply(pose.position) }
}

/// The pose with rounding replaced by zeros: the cosine of a quarter revolution is 6e-17.
pub fn tidy(pose: &Pose<f64>) -> Pose<f64> {
    let tidied = |x: [f64; 3]| x.map(|x| if x.abs() > ROUNDING { x } else { 0.0 });
    Pose { rotation: Matrix3(pose.rotation.0.map(tidied)), position: Vector3(tidied(pose.position.0)) }
}

fn link_twist(sin: f64, cos: f64) -> LinkTwist<f64> {
    if sin == 0.0 && cos > 0.0 {
        LinkTwist::Deg0
    } else if sin == 0.0 {
        LinkTwist::Deg180
    } else if cos == 0.0 && sin > 0.0 {
        LinkTwist::Deg90
    } else {
        LinkTwist::General(sin, cos)
    }
}

fn common_normal(from: Line, to: Line) -> Option<Normal> {
    let (z1, z2) = (from.direction, to.direction);
    let between = to.point - from.point;
    let across = z1.cross(z2);
    let sin = across.dot(across).sqrt();
    let cos = z1.dot(z2);
    if sin < PARALLEL {
        let normal = between - z1.scale(between.dot(z1));
        let length = normal.dot(normal).sqrt();
        let direction =
            if length > 1e-12 { normal.scale(1.0 / length) } else { perpendicular(z1, Matrix3::identity()) };
        return Some(Normal { feet: [from.point, from.point + normal], direction, sin: 0.0, cos: cos.signum() });
    }
    if sin < NEARLY_PARALLEL {
        return None;
    }
    // The normal's direction makes alpha lie between 0 and pi.
    let along = |z: Vector3<f64>| between.cross(z).dot(across) / (sin * sin);
    let feet = [from.point + z1.scale(along(z2)), to.point + z2.scale(along(z1))];
    let cos = if cos.abs() < PARALLEL { 0.0 } else { cos };
    Some(Normal { feet, direction: across.scale(1.0 / sin), sin, cos })
}

fn frame(origin: Vector3<f64>, x: Vector3<f64>, z: Vector3<f64>) -> Pose<f64> {
    let y = z.cross(x);
    Pose { rotation: Matrix3([x.0, y.0, z.0]).transposed().orthonormalised(), position: origin }
}

/// Unit vector perpendicular to `z`: the longest projection of one of these axes (columns).
fn perpendicular(z: Vector3<f64>, axes: Matrix3<f64>) -> Vector3<f64> {
    let across = axes.transposed().0.map(|axis| Vector3(axis) - z.scale(Vector3(axis).dot(z)));
    let length = |x: &Vector3<f64>| x.dot(*x).sqrt();
    let [mut x, others @ ..] = across;
    for other in others {
        if length(&other) > length(&x) {
            x = other;
        }
    }
    x.scale(1.0 / length(&x))
}

/// A vector of the scene.
pub fn vector(v: &na::Vector3<f64>) -> Vector3<f64> {
    Vector3([v.x, v.y, v.z])
}

/// Pose of a frame of the scene.
pub fn placed(frame: &Frame) -> Pose<f64> {
    let r = frame.rotation();
    let rotation = Matrix3([0, 1, 2].map(|i| [0, 1, 2].map(|k| r[(i, k)])));
    Pose { rotation, position: vector(&frame.position) }
}

/// The same without rounding.
pub fn pose(frame: &Frame) -> Pose<f64> {
    tidy(&placed(frame))
}

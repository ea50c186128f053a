//! Where the end effector is: forward kinematics and nothing else.

use nalgebra::{Matrix3, Vector3};

use super::state::Joints;
use crate::description::{Frame, Joint, JointKind, Scene};

/// The chain from the vehicle frame to the end effector.
#[derive(Debug, Clone, PartialEq)]
pub struct EndEffector {
    joints: Vec<Screw>,
    /// Pose in the frame of the last joint (of the vehicle, if there is none).
    tip: Placed,
}

/// A constant pose in a parent frame.
type Placed = (Matrix3<f64>, Vector3<f64>);

/// A joint: where it stands on its parent at q = 0, and how it moves.
#[derive(Debug, Clone, PartialEq)]
struct Screw {
    stand: Placed,
    kind: JointKind,
    axis: Vector3<f64>,
    /// `[axis]` and its square.
    cross: [Matrix3<f64>; 2],
}

impl EndEffector {
    /// The end effector of a checked scene: the vehicle frame if it has no arm.
    pub fn new(scene: &Scene) -> Self {
        let mut stand = (Matrix3::identity(), Vector3::zeros());
        let mut joints = Vec::new();
        if let Some(arm) = &scene.arm {
            stand = placed(&arm.mount.frame);
            for joint in scene.joints() {
                joints.push(Screw::new(joint, times(&stand, &placed(&joint.frame))));
                stand = (Matrix3::identity(), Vector3::zeros());
            }
            stand = times(&stand, &placed(&arm.end_effector));
        }
        Self { joints, tip: stand }
    }

    /// Rotation to the vehicle frame and position in it, m, at joint coordinates `q`. `[MLS94 sec. 3.2]`
    pub fn pose(&self, q: &Joints) -> (Matrix3<f64>, Vector3<f64>) {
        let mut at = (Matrix3::identity(), Vector3::zeros());
        for (joint, &q) in self.joints.iter().zip(q) {
            at = times(&at, &joint.stand);
            match joint.kind {
                JointKind::Revolute => {
                    let (sine, cosine) = q.sin_cos();
                    let [cross, square] = &joint.cross;
                    at.0 *= Matrix3::identity() + cross * sine + square * (1.0 - cosine);
                }
                JointKind::Prismatic => at.1 += at.0 * (joint.axis * q),
            }
        }
        times(&at, &self.tip)
    }
}

impl Screw {
    fn new(joint: &Joint, stand: Placed) -> Self {
        let axis = joint.axis.normalize();
        let cross = axis.cross_matrix();
        Self { stand, kind: joint.kind, axis, cross: [cross, cross * cross] }
    }
}

fn placed(frame: &Frame) -> Placed {
    (frame.rotation(), frame.position)
}

fn times(a: &Placed, b: &Placed) -> Placed {
    (a.0 * b.0, a.0 * b.1 + a.1)
}

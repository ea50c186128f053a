//! Coordinates in which a step's pose is integrated.

use super::StagePose;
use crate::lane::Lane;
use crate::lie::{Pose, Vector3, Vector6, exp_se3, rotate_back};

/// Coordinates of the pose within a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Chart {
    /// `T exp(Theta)` about the step's start, `Theta' = dexp^-1_(-Theta) V`: Munthe-Kaas methods. `[HC eq. 18]`
    Exponential,
    /// The same, only for Euler's rule; pose and joints move at the velocities of the step's end.
    VelocityFirst,
    /// Roll, pitch and yaw (`R = Rz Ry Rx`), and the position: singular at a pitch of 90 degrees. `[F21]`
    EulerAngles,
    /// Components of a quaternion, not necessarily of unit length, and the position: the paper's baseline. `[HC eq. 14]`
    Quaternion(Correction),
}

/// Correction of the quaternion's length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Correction {
    /// The term `gamma/2 (1 - Q^T Q) Q` of eq. 14.
    Fossen {
        /// Its gain, 1/s.
        gamma: f64,
    },
    /// Division by the length after each step.
    Normalise,
}

/// Representation of the attitude.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Attitude {
    /// Only the rotation matrix.
    Matrix,
    /// `[0, roll, pitch, yaw]`.
    Angles,
    /// A quaternion `[w, x, y, z]`.
    Quaternion,
}

impl Chart {
    /// Contents of [`super::Motion::attitude`].
    #[inline(always)]
    pub fn attitude(&self) -> Attitude {
        match self {
            Chart::Exponential | Chart::VelocityFirst => Attitude::Matrix,
            Chart::EulerAngles => Attitude::Angles,
            Chart::Quaternion(_) => Attitude::Quaternion,
        }
    }
}

/// The pose `T exp(theta)` of a stage.
pub(super) struct Increment<'a, L> {
    /// T.
    pub start: &'a Pose<L>,
    /// Theta; none at the step's start and for charts that give the whole pose.
    pub theta: Option<Vector6<L>>,
}

impl<L: Lane> StagePose<L> for Increment<'_, L> {
    #[inline(always)]
    fn is_start(&self) -> bool {
        self.theta.is_none()
    }
    #[inline(always)]
    fn to_body(&self, world: Vector3<L>) -> Vector3<L> {
        let body = self.start.rotation.apply_transposed(world);
        match self.theta {
            Some(theta) => rotate_back(theta.angular, body),
            None => body,
        }
    }
    #[inline(always)]
    fn start_and_motion(&self) -> (&Pose<L>, Option<Vector6<L>>) {
        (self.start, self.theta)
    }
    #[inline(always)]
    fn pose(&self) -> Pose<L> {
        match self.theta {
            Some(theta) => self.start.times(&exp_se3(theta)),
            None => *self.start,
        }
    }
}

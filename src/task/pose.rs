//! Poses of rigid frames in the world and their errors, and states of groups of instances.

use nalgebra as na;

use crate::lane::{Lane, Routine};
use crate::lie::{self, Matrix3, Vector3, Vector6, rotation_vector_and_angle};
use crate::system::{JOINTS, State};

/// A frame in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Origin, m.
    pub position: na::Vector3<f64>,
    /// Frame to world rotation.
    pub rotation: na::Matrix3<f64>,
}

impl Default for Pose {
    fn default() -> Self {
        Self { position: na::Vector3::zeros(), rotation: na::Matrix3::identity() }
    }
}

impl Pose {
    /// The vehicle's pose.
    pub fn of_vehicle(state: &State) -> Self {
        Self { position: state.position, rotation: state.rotation }
    }

    /// Rotation by a vector, rad, at the origin.
    pub fn turn(vector: na::Vector3<f64>) -> Self {
        Self { rotation: na::Rotation3::from_scaled_axis(vector).into_inner(), ..Self::default() }
    }

    /// Pose in the kernel's type.
    pub fn in_lanes(&self) -> lie::Pose<f64> {
        let rows = [0, 1, 2].map(|i| [0, 1, 2].map(|k| self.rotation[(i, k)]));
        lie::Pose { rotation: Matrix3(rows), position: Vector3(self.position.into()) }
    }
}

/// State of a group of instances, without the time.
#[derive(Debug, Clone, Copy)]
pub struct StageState<L> {
    /// Vehicle in the world.
    pub pose: lie::Pose<L>,
    /// Absolute body twist.
    pub twist: Vector6<L>,
    /// Joint coordinates, rad or m.
    pub q: [L; JOINTS],
    /// Joint rates, rad/s or m/s.
    pub qd: [L; JOINTS],
}

impl From<&State> for StageState<f64> {
    fn from(state: &State) -> Self {
        Self {
            pose: Pose::of_vehicle(state).in_lanes(),
            twist: Vector6::from_array(state.twist.into()),
            q: state.q,
            qd: state.qd,
        }
    }
}

/// Error of a pose with respect to a target pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseError<L> {
    /// `R^T (r - r_d)`, body axes, m.
    pub position: Vector3<L>,
    /// `log(R_d^T R)`, the same in body and in target axes, rad, at most pi long.
    pub rotation: Vector3<L>,
    /// Its length.
    pub angle: L,
    /// `R_d^T R`.
    pub turn: Matrix3<L>,
}

impl<L: Lane> PoseError<L> {
    /// Error of `pose` from `target`.
    #[inline(always)]
    pub fn of(pose: &lie::Pose<L>, target: &lie::Pose<L>) -> Self {
        let zero = lie::Vector3::zero();
        let mut error = Self { position: zero, rotation: zero, angle: L::zero(), turn: pose.rotation };
        L::call(&mut Comparison { pose, target, error: &mut error });
        error
    }
}

/// [`PoseError::of`], which several kernels share.
struct Comparison<'a, L: Lane> {
    pose: &'a lie::Pose<L>,
    target: &'a lie::Pose<L>,
    error: &'a mut PoseError<L>,
}

impl<L: Lane> Routine<L> for Comparison<'_, L> {
    const PORTABLE: bool = true;

    #[inline(always)]
    fn run(&mut self) {
        let Self { pose, target, error } = self;
        let turn = target.rotation.transposed().times(&pose.rotation);
        let (rotation, angle) = rotation_vector_and_angle(&turn);
        let position = pose.rotation.apply_transposed(pose.position - target.position);
        **error = PoseError { position, rotation, angle, turn };
    }
}

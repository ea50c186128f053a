//! State of a group of instances at a control instant.

use super::pose::Pose;
use crate::lie::{self, Vector6};
use crate::system::{JOINTS, State};

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

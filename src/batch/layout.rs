//! Memory of a block of instances: one row per number of the state and the loads, one column per instance.

use crate::hydro::{FINS, THRUSTERS};
use crate::integrate::{Attitude, Integrator};
use crate::system::{FACTORS, JOINTS};

/// First row of each entry. All numbers of an instance lie in one column of its block.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    /// Number of joints.
    pub joints: usize,
    /// R by rows, 9.
    pub rotation: usize,
    /// r, 3, and what rounding has left out of it, 3.
    pub position: usize,
    /// Absolute body twist, 6.
    pub twist: usize,
    /// q.
    pub q: usize,
    /// q'.
    pub qd: usize,
    /// Time and what rounding has left out of it, 2.
    pub time: usize,
    /// Velocity of the water in world axes, 3.
    pub current: usize,
    /// Its acceleration, 3.
    pub acceleration: usize,
    /// Wrench on the vehicle, 6.
    pub wrench: usize,
    /// Joint torques.
    pub torque: usize,
    /// Servo targets, 4 per joint.
    pub target: usize,
    /// Coordinates of the attitude that the integrator keeps besides the rotation: 4, or none.
    pub attitude: usize,
    /// What these are.
    pub keeps: Attitude,
    /// What was seen of the motion, 6: squares that show fast rates, and what steps get wrong.
    pub contrast: usize,
    /// Piece that the integrator plans, 1: only where it is adaptive.
    pub plan: usize,
    /// Whether it is.
    pub adaptive: bool,
    /// Factors on the instance's parameters, as [`crate::system::Factors`] has them.
    pub factors: usize,
    /// What is remembered of the steps before, 1 + 12 per body: only where added mass is a lagged force.
    pub lag: usize,
    /// Whether it is.
    pub lagged: bool,
    /// Number of thrusters with a state of their own: all, if any has dynamics, else none.
    pub thrusters: usize,
    /// Commanded thrusts, of these.
    pub command: usize,
    /// Thrusts in still water, of these: their state.
    pub thrust: usize,
    /// Share of its thrust that each of these has lost.
    pub loss: usize,
    /// Number of fins.
    pub fins: usize,
    /// Their deflections.
    pub fin: usize,
    /// Rows that every step may need: those so far.
    pub common: usize,
    /// External wrenches on the links, 6 per joint.
    pub links: usize,
    /// Station: target rotation (9) and position (3).
    pub station: usize,
    /// Rows in all.
    pub rows: usize,
}

impl Layout {
    /// Layout for numbers of joints, of thrusters with a state and of fins, and for what an integrator keeps.
    pub fn new(joints: usize, thrusters: usize, fins: usize, integrator: &Integrator) -> Self {
        assert!(joints <= JOINTS && thrusters <= THRUSTERS && fins <= FINS);
        let (keeps, adaptive) = (integrator.attitude(), integrator.adaptive());
        let lagged = integrator.lag().is_some();
        let mut rows = 0;
        let mut take = |count: usize| {
            rows += count;
            rows - count
        };
        Self {
            joints,
            rotation: take(9),
            position: take(6),
            twist: take(6),
            q: take(joints),
            qd: take(joints),
            time: take(2),
            current: take(3),
            acceleration: take(3),
            wrench: take(6),
            torque: take(joints),
            target: take(4 * joints),
            factors: take(FACTORS),
            attitude: take(if keeps == Attitude::Matrix { 0 } else { 4 }),
            keeps,
            contrast: take(6),
            plan: take(usize::from(adaptive)),
            adaptive,
            lag: take(if lagged { 1 + 12 * (joints + 1) } else { 0 }),
            lagged,
            thrusters,
            command: take(thrusters),
            thrust: take(thrusters),
            loss: take(thrusters),
            fins,
            fin: take(fins),
            common: take(0),
            links: take(6 * joints),
            station: take(12),
            rows: take(0),
        }
    }
}

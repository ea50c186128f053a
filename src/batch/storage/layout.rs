//! Layout of a block of instances: one row per number of the state and the loads, one column per instance.

use crate::hydro::{FINS, THRUSTERS};
use crate::integrate::{Attitude, Integrator};
use crate::lane::Real;
use crate::system::{FACTORS, JOINTS};

/// First row of each quantity. All numbers of an instance lie in one column of its block.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    /// Number of joints.
    pub joints: usize,
    /// R by rows, 9.
    pub rotation: usize,
    /// r, 3, and its rounding error, 3 (compensated sum).
    pub position: usize,
    /// Absolute body twist, 6.
    pub twist: usize,
    /// q.
    pub q: usize,
    /// q'.
    pub qd: usize,
    /// Rounding error of q (compensated sum), in single precision.
    pub q_rest: usize,
    /// Number of these.
    pub rests: usize,
    /// Time, and its rounding error, 2 (compensated sum).
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
    /// Attitude coordinates that the integrator keeps besides the rotation: 4, or none.
    pub attitude: usize,
    /// Their kind.
    pub keeps: Attitude,
    /// Estimates of the quality of the last steps, 6: contrast of the stages, velocity error, spin error.
    pub estimates: usize,
    /// Sub-interval that the integrator plans next, 1: only where it is adaptive.
    pub planned: usize,
    /// True where the integrator is adaptive.
    pub adaptive: bool,
    /// Factors on the instance's parameters, in the order of [`crate::system::Factors`].
    pub factors: usize,
    /// State of the acceleration filter, 1 + 12 per body: only where added mass is a lagged force.
    pub lag: usize,
    /// True where added mass is a lagged force.
    pub lagged: bool,
    /// Number of thrusters with a state: all where any has dynamics, else none.
    pub thrusters: usize,
    /// Their commanded thrusts.
    pub command: usize,
    /// Their thrusts in still water: the state.
    pub thrust: usize,
    /// Fraction of its thrust that each has lost.
    pub loss: usize,
    /// Number of fins.
    pub fins: usize,
    /// Their deflections.
    pub fin: usize,
    /// Number of rows that every step may need: those above.
    pub common: usize,
    /// External wrenches on the links, 6 per joint.
    pub links: usize,
    /// Target of the vehicle's servo: rotation (9) and position (3).
    pub station: usize,
    /// Number of rows.
    pub rows: usize,
    /// Rows of the instance's companion, where errors are estimated.
    pub companion: Option<Box<CompanionRows>>,
}

/// Rows of the companion of an instance: a second integration of its motion at another step, under the same inputs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CompanionRows {
    /// Its layout: rows of its own for the state, those of the instance for all else.
    pub layout: Layout,
    /// Each row of the state of the instance and that of the companion; time and velocity of the water are the last [`GIVEN`].
    pub state: Vec<[usize; 2]>,
    /// 1 where it follows the motion of the instance; 0 where the instance's state has been set since the last step.
    pub follows: usize,
    /// Least divisor of the differences since it follows: see [`crate::batch::stepping::companion`].
    pub divisor: usize,
    /// Position (3), rotation by rows (9) and joint coordinates of the instance when it began to follow.
    pub start: usize,
    /// Scales of the motion since then, [`SCALES`].
    pub scales: usize,
    /// Estimated error relative to these scales, 1.
    pub relative: usize,
}

/// Rows of the state that are the instance's at the start of every call: time (2), velocity of the water (3).
pub const GIVEN: usize = 5;
/// Scales of a motion: greatest distance (m), rotation (rad) and joint travel (rad or m) from the start, and greatest speed
/// (m/s), spin (rad/s) and joint rate (rad/s or m/s).
pub const SCALES: usize = 6;

impl Layout {
    /// Layout for numbers of joints, of thrusters with a state and of fins, for an integrator and a precision.
    pub fn new<T: Real>([joints, thrusters, fins]: [usize; 3], integrator: &Integrator) -> Self {
        assert!(joints <= JOINTS && thrusters <= THRUSTERS && fins <= FINS);
        let (keeps, adaptive) = (integrator.attitude(), integrator.adaptive());
        let lagged = integrator.lag().is_some();
        let rests = if T::SINGLE { joints } else { 0 };
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
            q_rest: take(rests),
            rests,
            time: take(2),
            current: take(3),
            acceleration: take(3),
            wrench: take(6),
            torque: take(joints),
            target: take(4 * joints),
            factors: take(FACTORS),
            attitude: take(if keeps == Attitude::Matrix { 0 } else { 4 }),
            keeps,
            estimates: take(6),
            planned: take(usize::from(adaptive)),
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
            companion: None,
        }
    }

    /// The same with a companion for each instance.
    pub fn with_companion(mut self) -> Self {
        let mut rows = self.rows;
        let mut take = |count: usize| {
            rows += count;
            rows - count
        };
        let (mut own, mut state) = (self.clone(), Vec::new());
        for (row, count) in own.state_rows() {
            let first = take(count);
            state.extend((0..count).map(|k| [*row + k, first + k]));
            *row = first;
        }
        let (follows, divisor, start) = (take(1), take(1), take(12 + self.joints));
        let (scales, relative) = (take(SCALES), take(1));
        (self.rows, own.rows) = (rows, rows);
        self.companion =
            Some(Box::new(CompanionRows { layout: own, state, follows, divisor, start, scales, relative }));
        self
    }

    /// First row and number of rows of all that a step changes.
    fn state_rows(&mut self) -> [(&mut usize, usize); 13] {
        let (joints, rests, thrusters) = (self.joints, self.rests, self.thrusters);
        let attitude = if self.keeps == Attitude::Matrix { 0 } else { 4 };
        let lag = if self.lagged { 1 + 12 * (joints + 1) } else { 0 };
        [
            (&mut self.rotation, 9),
            (&mut self.position, 6),
            (&mut self.twist, 6),
            (&mut self.q, joints),
            (&mut self.qd, joints),
            (&mut self.q_rest, rests),
            (&mut self.attitude, attitude),
            (&mut self.estimates, 6),
            (&mut self.planned, usize::from(self.adaptive)),
            (&mut self.lag, lag),
            (&mut self.thrust, thrusters),
            (&mut self.time, 2),
            (&mut self.current, 3),
        ]
    }
}

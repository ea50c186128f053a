//! Layout of a block of instances: one row per number of the state and the loads, one column per instance.

use crate::hydro::THRUSTERS;
use crate::integrate::{Attitude, Integrator};
use crate::lane::Real;
use crate::system::{FACTORS, JOINTS};
use crate::terms::FINS;

/// Index of the number in row `row` of instance `i` in blocks of `rows` rows.
#[inline]
pub fn index<T: Real>(rows: usize, i: usize, row: usize) -> usize {
    (i / T::BLOCK * rows + row) * T::BLOCK + i % T::BLOCK
}

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
    /// Joint coordinates.
    pub q: usize,
    /// Joint rates.
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
    /// Attitude coordinates of the integrator besides the rotation: 4, or none.
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
    /// Number of rows that every step may need: all rows above.
    pub common: usize,
    /// External wrenches on the links, 6 per joint.
    pub links: usize,
    /// Target of the vehicle's servo: rotation (9) and position (3).
    pub station: usize,
    /// Number of rows.
    pub rows: usize,
}

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
        }
    }

    /// First row and number of rows of all that acts on an instance: flow of the water, loads, factors, thrusters and fins.
    pub fn load_rows(&self) -> [[usize; 2]; 11] {
        let &Self { joints, thrusters, .. } = self;
        [
            [self.current, 3],
            [self.acceleration, 3],
            [self.wrench, 6],
            [self.torque, joints],
            [self.target, 4 * joints],
            [self.factors, FACTORS],
            [self.command, thrusters],
            [self.loss, thrusters],
            [self.fin, self.fins],
            [self.links, 6 * joints],
            [self.station, 12],
        ]
    }

    /// First row and number of rows of integrators' memory besides the state: attitude coordinates, and the acceleration filter.
    pub fn memory_rows(&self) -> [[usize; 2]; 2] {
        let attitude = if self.keeps == Attitude::Matrix { 0 } else { 4 };
        let lag = if self.lagged { 1 + 12 * (self.joints + 1) } else { 0 };
        [[self.attitude, attitude], [self.lag, lag]]
    }
}

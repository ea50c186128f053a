//! Station keeping: the plan of thrusts that hold the vehicle, while the arm's servos move the arm.

use nalgebra::{DMatrix, DVector, Vector6};

use super::CANCELLING;
use super::gains::NmpcGains;
use super::real_time::{Cost, Model, Plan};
use crate::control::ActionMap;
use crate::control::indices::ATTITUDE_LEVER;
use crate::control::kalman::WaveTransition;
use crate::control::observer::Observer;
use crate::control::plant::{AppliedWrenches, ArmMotion, Plant, VehicleMotion};
use crate::control::rows::WIDEST;
use crate::description::Scene;
use crate::dynamics::aba::Scratch;
use crate::lane::{Isa, Kernel, Lane, Real};
use crate::lie::Vector6 as Lanes6;
use crate::system::JOINTS;

/// Control periods of a plan.
pub const HORIZON: usize = 8;
/// Entries of a state: pose error, twist, wrench of the thrusters.
pub const STATES: usize = 18;
/// Step of differences.
const STEP: f64 = 1e-5;
/// Minimum weight on effort, m2: without any the cost has no minimum.
const MIN_EFFORT: f64 = 1e-8;

/// Estimate of the present, of one instance.
#[derive(Debug, Clone, PartialEq)]
pub struct Present {
    /// Pose error, twist and wrench of the thrusters.
    pub state: [[f64; 6]; 3],
    /// Slow disturbance, wave and its rate; then the steady external wrench: forces of the model and the slow
    /// disturbance.
    pub wrenches: [[f64; 6]; 4],
    /// Arm now and a control period later.
    pub arms: [ArmMotion<f64>; 2],
}

/// Plans of thrusts over the next [`HORIZON`] control periods.
#[derive(Debug, Clone, PartialEq)]
pub struct VehicleNmpc {
    gains: NmpcGains,
    plant: Plant,
    period: f64,
    /// Wrench per relative thrust, and its pseudo-inverse.
    wrench: DMatrix<f64>,
    inverse: DMatrix<f64>,
    bounds: [DVector<f64>; 2],
    pub cost: Cost,
    /// Transitions of waves from now to the middle of each control period.
    waves: Vec<WaveTransition>,
}

impl VehicleNmpc {
    pub fn new(gains: NmpcGains, scene: &Scene, observer: &Observer, actions: &ActionMap) -> Self {
        let (allocation, period) = (actions.allocation(), observer.period());
        let (count, unit) = (allocation.count(), allocation.wrench_limits());
        let wrench = DMatrix::from_fn(6, count, |k, i| allocation.column(i)[k] * allocation.range(i));
        let over = |i: usize, x: f64| if allocation.range(i) > 0.0 { x / allocation.range(i) } else { 0.0 };
        let inverse = DMatrix::from_fn(count, 6, |i, k| over(i, allocation.pseudo_inverse(i)[k]));
        let bounds = [0, 1].map(|side| DVector::from_fn(count, |i, _| over(i, allocation.limits(i)[side])));
        let middle = |k: usize| WaveTransition::over(gains.wave_frequency, (k as f64 + 0.5) * period);
        let waves = (0..=HORIZON).map(middle).collect();
        let plant = observer.plant().clone();
        let empty = Cost { hessian: DMatrix::zeros(0, 0), end: DMatrix::zeros(0, 0) };
        let mut nmpc = Self { gains, plant, period, wrench, inverse, bounds, cost: empty, waves };
        let q = scene.home();
        let still = ArmMotion { q, qd: [0.0; JOINTS] };
        let rest = Present { state: [[0.0; 6]; 3], wrenches: [[0.0; 6]; 4], arms: [still; 2] };
        nmpc.cost = Cost::new(&nmpc.roots(&unit), &nmpc.dynamics(&rest));
        nmpc
    }

    pub fn gains(&self) -> &NmpcGains {
        &self.gains
    }

    /// Numbers of memory per instance: the plan's relative thrusts.
    pub fn memory(&self) -> usize {
        HORIZON * self.bounds[0].len()
    }

    /// Roots of a knot's cost: rows of weighted residuals of `z = [pose error; twist; thrusters' wrench; thrusts]`.
    fn roots(&self, unit: &[f64; 6]) -> DMatrix<f64> {
        let (count, gains) = (self.inverse.nrows(), &self.gains);
        let root = |k: usize, weight: f64| if unit[k] > 0.0 { weight.sqrt() } else { 0.0 };
        let over = |k: usize, weight: f64| if unit[k] > 0.0 { weight.sqrt() / unit[k] } else { 0.0 };
        let mut roots = DMatrix::zeros(24 + count, STATES + count);
        for k in 0..6 {
            let lever = if k < 3 { 1.0 } else { ATTITUDE_LEVER };
            roots[(k, k)] = root(k, 1.0) * lever;
            roots[(6 + k, 6 + k)] = root(k, gains.velocity[k / 3]) * lever;
            let (effort, change) = (gains.effort[k / 3].max(MIN_EFFORT), gains.change[k / 3]);
            let row = self.wrench.row(k);
            roots.view_mut((12 + k, STATES), (1, count)).copy_from(&(row * over(k, effort)));
            roots.view_mut((18 + k, STATES), (1, count)).copy_from(&(row * over(k, change)));
            roots[(18 + k, 12 + k)] = -over(k, change);
        }
        let most = gains.effort.iter().chain(&gains.change).fold(MIN_EFFORT, |a, b| a.max(*b));
        let cancelling = DMatrix::identity(count, count) - &self.inverse * &self.wrench;
        roots.view_mut((24, STATES), (count, count)).copy_from(&(cancelling * (CANCELLING * most).sqrt()));
        roots
    }

    fn at<'a>(&'a self, present: &'a Present) -> VehicleModel<'a> {
        VehicleModel { nmpc: self, present }
    }

    /// Derivatives of a control period by state and relative thrusts.
    pub fn dynamics(&self, present: &Present) -> DMatrix<f64> {
        self.at(present).dynamics()
    }

    /// Wrench of the plan from the present on, which the memory holds and gets.
    pub fn plan(&self, present: &Present, memory: &mut [f64]) -> [f64; 6] {
        let state = DVector::from_column_slice(present.state.as_flattened());
        let model = self.at(present);
        let targets: Vec<_> = (0..=HORIZON).map(|k| self.target(k, present)).collect();
        let dynamics = model.dynamics();
        let plan = Plan::new(&model, (&self.cost, &dynamics), &targets, &self.bounds, state, memory);
        let wrench = &self.wrench * plan.improve(memory);
        std::array::from_fn(|k| wrench[k])
    }

    /// z of a knot that holds the vehicle at its target.
    fn target(&self, knot: usize, present: &Present) -> DVector<f64> {
        let [_, wave, rate, steady] = present.wrenches.map(Vector6::from);
        let WaveTransition([[a, b], _]) = self.waves[knot];
        let hold = -(steady + wave * a + rate * b);
        let entries = if knot < HORIZON { STATES + self.inverse.nrows() } else { STATES };
        let mut target = DVector::zeros(entries);
        target.rows_mut(12, 6).copy_from(&hold);
        if knot < HORIZON {
            target.rows_mut(STATES, self.inverse.nrows()).copy_from(&(&self.inverse * hold));
        }
        target
    }
}

/// The nominal model from the present on.
struct VehicleModel<'a> {
    nmpc: &'a VehicleNmpc,
    present: &'a Present,
}

impl VehicleModel<'_> {
    /// States after a control period for rows of state and command.
    fn steps(&self, knot: usize, rows: &[[f64; STATES + 6]]) -> Vec<[f64; STATES]> {
        let [now, next] = &self.present.arms;
        let arms = [0.0, 1.0].map(|ahead| next.less(now).scale_add(knot as f64 + ahead, now));
        let [slow, wave, rate, _] = self.present.wrenches.map(Vector6::from);
        let WaveTransition([[a, b], _]) = self.nmpc.waves[knot];
        let mut ends = vec![[0.0; STATES]; rows.len()];
        let disturbance = slow + wave * a + rate * b;
        let mut kernel =
            Steps { plant: &self.nmpc.plant, period: self.nmpc.period, arms, disturbance, rows, ends: &mut ends };
        let isa = Isa::best().unwrap_or(Isa::Plain);
        if rows.len() == 1 {
            f64::dispatch_narrow(isa, &mut kernel)
        } else {
            f64::dispatch(isa, &mut kernel)
        }
        ends
    }

    /// Derivatives of the first control period by state and relative thrusts, at the present state and command.
    fn dynamics(&self) -> DMatrix<f64> {
        let mut at = [0.0; STATES + 6];
        at[..STATES].copy_from_slice(self.present.state.as_flattened());
        at.copy_within(12..STATES, STATES);
        let mut rows = vec![at; 2 * (STATES + 6)];
        for k in 0..STATES + 6 {
            rows[2 * k][k] -= STEP;
            rows[2 * k + 1][k] += STEP;
        }
        let ends = self.steps(0, &rows);
        let column = |i: usize, k: usize| (ends[2 * k + 1][i] - ends[2 * k][i]) / (2.0 * STEP);
        let by_state = DMatrix::from_fn(STATES, STATES, column);
        let by_inputs = DMatrix::from_fn(STATES, 6, |i, k| column(i, STATES + k)) * &self.nmpc.wrench;
        let mut dynamics = DMatrix::zeros(STATES, STATES + by_inputs.ncols());
        dynamics.columns_mut(0, STATES).copy_from(&by_state);
        dynamics.columns_mut(STATES, by_inputs.ncols()).copy_from(&by_inputs);
        dynamics
    }
}

impl Model for VehicleModel<'_> {
    fn step(&self, knot: usize, state: &DVector<f64>, inputs: &DVector<f64>) -> DVector<f64> {
        let mut row = [0.0; STATES + 6];
        row[..STATES].copy_from_slice(state.as_slice());
        row[STATES..].copy_from_slice((&self.nmpc.wrench * inputs).as_slice());
        DVector::from_column_slice(&self.steps(knot, &[row])[0])
    }
}

/// A control period for rows of state and command, in lanes.
struct Steps<'a> {
    plant: &'a Plant,
    period: f64,
    arms: [ArmMotion<f64>; 2],
    disturbance: Vector6<f64>,
    rows: &'a [[f64; STATES + 6]],
    ends: &'a mut [[f64; STATES]],
}

impl Kernel<f64> for Steps<'_> {
    #[inline(always)]
    fn run<L: Lane<Real = f64>>(&mut self) {
        let mut scratch = Scratch::new();
        let mut arms = [ArmMotion { q: [L::zero(); JOINTS], qd: [L::zero(); JOINTS] }; 2];
        for (arm, from) in arms.iter_mut().zip(&self.arms) {
            for k in 0..JOINTS {
                (arm.q[k], arm.qd[k]) = (L::c(from.q[k]), L::c(from.qd[k]));
            }
        }
        let mut disturbance = [L::zero(); 6];
        for k in 0..6 {
            disturbance[k] = L::c(self.disturbance[k]);
        }
        for first in (0..self.rows.len()).step_by(L::LANES) {
            let last = self.rows.len() - 1;
            let mut six = [Lanes6::zero(); 4];
            for (part, six) in six.iter_mut().enumerate() {
                let mut entries = [L::zero(); 6];
                for k in 0..6 {
                    let mut all = [0.0; WIDEST];
                    for lane in 0..L::LANES {
                        all[lane] = self.rows[(first + lane).min(last)][6 * part + k];
                    }
                    entries[k] = L::load(&all);
                }
                *six = Lanes6::from_array(entries);
            }
            let [error, twist, thrust, command] = six;
            let wrenches = AppliedWrenches { command, thrust, disturbance: Lanes6::from_array(disturbance) };
            let from = VehicleMotion { error, twist };
            let end = self.plant.predict(&from, [&arms[0], &arms[1]], &wrenches, self.period, &mut scratch);
            for (part, six) in [end.motion.error, end.motion.twist, end.thrust].into_iter().enumerate() {
                for (k, x) in six.to_array().into_iter().enumerate() {
                    let mut all = [0.0; WIDEST];
                    x.store(&mut all);
                    for lane in 0..L::LANES.min(self.rows.len() - first) {
                        self.ends[first + lane][6 * part + k] = all[lane];
                    }
                }
            }
        }
    }
}

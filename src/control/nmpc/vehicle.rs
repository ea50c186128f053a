//! Station keeping: the plan of thrusts that hold the vehicle, while the arm's servos move the arm.

use nalgebra::{DMatrix, DVector, Vector6};

use super::gains::NmpcGains;
use super::real_time::{Cost, PlanModel, RealTimePlan};
use crate::control::ActionMap;
use crate::control::kalman::WaveTransition;
use crate::control::nominal_model::{AppliedWrenches, ArmState, NominalModel, VehicleMotion};
use crate::control::observer::{Observer, load, store};
use crate::control::thrusts::{RelativeThrusts, without};
use crate::description::Scene;
use crate::dynamics::aba::Scratch;
use crate::lane::{Function, Lane, differentiate, evaluate};
use crate::lie::Vector6 as Lanes6;
use crate::optimize::cost_to_go;
use crate::system::JOINTS;

/// Control periods of a plan.
pub const HORIZON: usize = 8;
/// Entries of a state: pose error, twist, wrench of the thrusters.
pub const STATES: usize = 18;

/// Estimate of the present, of one instance.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanStart {
    /// Pose error, twist and wrench of the thrusters.
    pub state: [[f64; 6]; 3],
    /// Slow disturbance, wave and its rate; then the steady external wrench: forces of the model and the slow
    /// disturbance.
    pub wrenches: [[f64; 6]; 4],
    /// Arm now and a control period later.
    pub arms: [ArmState<f64>; 2],
}

/// Plans of thrusts over the next [`HORIZON`] control periods.
#[derive(Debug, Clone, PartialEq)]
pub struct VehicleNmpc {
    model: NominalModel,
    period: f64,
    thrusts: RelativeThrusts,
    /// Cost of a plan.
    pub cost: Cost,
    /// Transitions of waves from now to the middle of each control period.
    waves: Vec<WaveTransition>,
}

impl VehicleNmpc {
    /// For a checked scene.
    pub fn new(gains: &NmpcGains, scene: &Scene, observer: &Observer, actions: &ActionMap) -> Self {
        let (allocation, period) = (actions.allocation(), observer.period());
        let thrusts = RelativeThrusts::new(allocation);
        let middle = |k: usize| WaveTransition::over(gains.wave_frequency, (k as f64 + 0.5) * period);
        let waves = (0..=HORIZON).map(middle).collect();
        let unit = allocation.wrench_limits();
        let axes = (unit.map(|limit| limit > 0.0), &unit);
        let roots = gains.roots(&thrusts, axes, [6, 12, STATES], STATES + thrusts.count());
        let roots = DMatrix::from_columns(&roots).transpose();
        let cost = Cost { hessian: roots.tr_mul(&roots), end: DMatrix::zeros(0, 0) };
        let mut nmpc = Self { model: observer.model().clone(), period, thrusts, cost, waves };
        let still = ArmState { q: scene.home(), qd: [0.0; JOINTS] };
        let rest = PlanStart { state: [[0.0; 6]; 3], wrenches: [[0.0; 6]; 4], arms: [still; 2] };
        nmpc.cost.end = cost_to_go(&nmpc.cost.hessian, &nmpc.dynamics(&rest));
        nmpc
    }

    /// Numbers of memory per instance: the plan's relative thrusts.
    pub fn memory(&self) -> usize {
        HORIZON * self.thrusts.count()
    }

    /// Derivatives of the first control period by state and relative thrusts, at the present state and command.
    pub fn dynamics(&self, present: &PlanStart) -> DMatrix<f64> {
        let mut at = [0.0; STATES + 6];
        at[..STATES].copy_from_slice(present.state.as_flattened());
        at.copy_within(12..STATES, STATES);
        let by: Vec<usize> = (0..STATES + 6).collect();
        let (_, columns) = differentiate(&self.period(0, present), &at, &by);
        let all = DMatrix::from_fn(STATES, STATES + 6, |i, k| columns[k][i]);
        let by_thrusts = all.columns(STATES, 6) * &self.thrusts.wrench;
        let columns: Vec<_> = all.column_iter().take(STATES).chain(by_thrusts.column_iter()).collect();
        DMatrix::from_columns(&columns)
    }

    /// Improves the plan in the memory from the present on, without a lost thruster, and returns its first wrench.
    pub fn plan(&self, present: &PlanStart, lost: Option<usize>, memory: &mut [f64]) -> [f64; 6] {
        let state = DVector::from_column_slice(present.state.as_flattened());
        let model = VehicleModel { nmpc: self, present };
        let targets: Vec<_> = (0..=HORIZON).map(|k| self.target(k, present)).collect();
        let dynamics = self.dynamics(present);
        let bounds = without(&self.thrusts.bounds, lost, self.thrusts.count());
        let plan = RealTimePlan::new(&model, (&self.cost, &dynamics), &targets, &bounds, state, memory);
        let wrench = &self.thrusts.wrench * plan.improve(memory);
        std::array::from_fn(|k| wrench[k])
    }

    /// z of a knot that holds the vehicle at its target.
    fn target(&self, knot: usize, present: &PlanStart) -> DVector<f64> {
        let [_, wave, rate, steady] = present.wrenches.map(Vector6::from);
        let WaveTransition([[a, b], _]) = self.waves[knot];
        let hold = -(steady + wave * a + rate * b);
        let mut target = DVector::zeros(STATES + self.thrusts.count());
        target.rows_mut(12, 6).copy_from(&hold);
        target.rows_mut(STATES, self.thrusts.count()).copy_from(&(&self.thrusts.inverse * hold));
        if knot < HORIZON { target } else { target.rows(0, STATES).into_owned() }
    }

    /// A control period of the plan.
    fn period(&self, knot: usize, present: &PlanStart) -> ControlPeriod<'_> {
        let [now, next] = &present.arms;
        let [slow, wave, rate, _] = present.wrenches.map(Vector6::from);
        let WaveTransition([[a, b], _]) = self.waves[knot];
        ControlPeriod {
            model: &self.model,
            period: self.period,
            arms: [0.0, 1.0].map(|ahead| next.minus(now).scale_add(knot as f64 + ahead, now)),
            disturbance: (slow + wave * a + rate * b).into(),
        }
    }
}

/// The nominal model from the present on.
struct VehicleModel<'a> {
    nmpc: &'a VehicleNmpc,
    present: &'a PlanStart,
}

impl PlanModel for VehicleModel<'_> {
    fn step(&self, knot: usize, state: &DVector<f64>, inputs: &DVector<f64>) -> DVector<f64> {
        let mut x = [0.0; STATES + 6];
        x[..STATES].copy_from_slice(state.as_slice());
        x[STATES..].copy_from_slice((&self.nmpc.thrusts.wrench * inputs).as_slice());
        DVector::from_column_slice(&evaluate(&self.nmpc.period(knot, self.present), &x))
    }
}

/// A control period, from state and command to the state at its end.
struct ControlPeriod<'a> {
    model: &'a NominalModel,
    period: f64,
    arms: [ArmState<f64>; 2],
    disturbance: [f64; 6],
}

impl Function<{ STATES + 6 }, STATES> for ControlPeriod<'_> {
    type Memory<L: Lane> = Scratch<L>;

    #[inline(always)]
    fn at<L: Lane<Real = f64>>(&self, x: &[L; STATES + 6], scratch: &mut Scratch<L>) -> [L; STATES] {
        let mut arms = [ArmState { q: [L::zero(); JOINTS], qd: [L::zero(); JOINTS] }; 2];
        for i in 0..2 {
            for k in 0..JOINTS {
                (arms[i].q[k], arms[i].qd[k]) = (L::c(self.arms[i].q[k]), L::c(self.arms[i].qd[k]));
            }
        }
        let mut disturbance = [L::zero(); 6];
        for k in 0..6 {
            disturbance[k] = L::c(self.disturbance[k]);
        }
        let from = VehicleMotion { error: load(x, 0), twist: load(x, 6) };
        let disturbance = Lanes6::from_array(disturbance);
        let wrenches = AppliedWrenches { command: load(x, STATES), thrust: load(x, 12), disturbance };
        let end = self.model.predict(&from, [&arms[0], &arms[1]], &wrenches, self.period, scratch);
        let mut state = [L::zero(); STATES];
        store(&mut state, 0, end.motion.error);
        store(&mut state, 6, end.motion.twist);
        store(&mut state, 12, end.thrust);
        state
    }
}

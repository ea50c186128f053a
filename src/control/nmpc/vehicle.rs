//! Station keeping: the plan of thrusts that hold the vehicle, while the arm's servos move the arm.

use nalgebra::{DMatrix, DVector, Vector6};

use super::gains::NmpcGains;
use super::real_time::{Cost, PlanModel, RealTimePlan};
use crate::control::ActionMap;
use crate::control::kalman::WaveTransition;
use crate::control::nominal_model::{AppliedWrenches, ArmState, NominalModel, VehicleMotion};
use crate::control::observer::Observer;
use crate::control::thrusts::RelativeThrusts;
use crate::description::Scene;
use crate::dynamics::aba::Scratch;
use crate::lane::{Function, Lane, differentiate, evaluate};
use crate::lie::Vector6 as Lanes6;
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
        let empty = Cost { hessian: DMatrix::zeros(0, 0), end: DMatrix::zeros(0, 0) };
        let mut nmpc = Self { model: observer.model().clone(), period, thrusts, cost: empty, waves };
        let still = ArmState { q: scene.home(), qd: [0.0; JOINTS] };
        let rest = PlanStart { state: [[0.0; 6]; 3], wrenches: [[0.0; 6]; 4], arms: [still; 2] };
        nmpc.cost = Cost::new(&DMatrix::from_columns(&roots).transpose(), &nmpc.dynamics(&rest));
        nmpc
    }

    /// Numbers of memory per instance: the plan's relative thrusts.
    pub fn memory(&self) -> usize {
        HORIZON * self.thrusts.count()
    }

    fn at<'a>(&'a self, present: &'a PlanStart) -> VehicleModel<'a> {
        VehicleModel { nmpc: self, present }
    }

    /// Derivatives of a control period by state and relative thrusts.
    pub fn dynamics(&self, present: &PlanStart) -> DMatrix<f64> {
        self.at(present).dynamics()
    }

    /// Improves the plan in the memory from the present on, and returns its first wrench.
    pub fn plan(&self, present: &PlanStart, memory: &mut [f64]) -> [f64; 6] {
        let state = DVector::from_column_slice(present.state.as_flattened());
        let model = self.at(present);
        let targets: Vec<_> = (0..=HORIZON).map(|k| self.target(k, present)).collect();
        let dynamics = model.dynamics();
        let plan = RealTimePlan::new(&model, (&self.cost, &dynamics), &targets, &self.thrusts.bounds, state, memory);
        let wrench = &self.thrusts.wrench * plan.improve(memory);
        std::array::from_fn(|k| wrench[k])
    }

    /// z of a knot that holds the vehicle at its target.
    fn target(&self, knot: usize, present: &PlanStart) -> DVector<f64> {
        let [_, wave, rate, steady] = present.wrenches.map(Vector6::from);
        let WaveTransition([[a, b], _]) = self.waves[knot];
        let hold = -(steady + wave * a + rate * b);
        let entries = if knot < HORIZON { STATES + self.thrusts.inverse.nrows() } else { STATES };
        let mut target = DVector::zeros(entries);
        target.rows_mut(12, 6).copy_from(&hold);
        if knot < HORIZON {
            target.rows_mut(STATES, self.thrusts.inverse.nrows()).copy_from(&(&self.thrusts.inverse * hold));
        }
        target
    }
}

/// The nominal model from the present on.
struct VehicleModel<'a> {
    nmpc: &'a VehicleNmpc,
    present: &'a PlanStart,
}

impl VehicleModel<'_> {
    /// A control period of the plan.
    fn period(&self, knot: usize) -> ControlPeriod<'_> {
        let [now, next] = &self.present.arms;
        let [slow, wave, rate, _] = self.present.wrenches.map(Vector6::from);
        let WaveTransition([[a, b], _]) = self.nmpc.waves[knot];
        ControlPeriod {
            model: &self.nmpc.model,
            period: self.nmpc.period,
            arms: [0.0, 1.0].map(|ahead| next.minus(now).scale_add(knot as f64 + ahead, now)),
            disturbance: (slow + wave * a + rate * b).into(),
        }
    }

    /// Derivatives of the first control period by state and relative thrusts, at the present state and command.
    fn dynamics(&self) -> DMatrix<f64> {
        let mut at = [0.0; STATES + 6];
        at[..STATES].copy_from_slice(self.present.state.as_flattened());
        at.copy_within(12..STATES, STATES);
        let by: Vec<usize> = (0..STATES + 6).collect();
        let (_, columns) = differentiate(&self.period(0), &at, &by);
        let all = DMatrix::from_fn(STATES, STATES + 6, |i, k| columns[k][i]);
        let mut dynamics = DMatrix::zeros(STATES, STATES + self.nmpc.thrusts.count());
        dynamics.columns_mut(0, STATES).copy_from(&all.columns(0, STATES));
        dynamics
            .columns_mut(STATES, self.nmpc.thrusts.count())
            .copy_from(&(all.columns(STATES, 6) * &self.nmpc.thrusts.wrench));
        dynamics
    }
}

impl PlanModel for VehicleModel<'_> {
    fn step(&self, knot: usize, state: &DVector<f64>, inputs: &DVector<f64>) -> DVector<f64> {
        let mut x = [0.0; STATES + 6];
        x[..STATES].copy_from_slice(state.as_slice());
        x[STATES..].copy_from_slice((&self.nmpc.thrusts.wrench * inputs).as_slice());
        DVector::from_column_slice(&evaluate(&self.period(knot), &x))
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
    #[inline(always)]
    fn at<L: Lane<Real = f64>>(&self, x: &[L; STATES + 6]) -> [L; STATES] {
        let mut arms = [ArmState { q: [L::zero(); JOINTS], qd: [L::zero(); JOINTS] }; 2];
        for i in 0..2 {
            for k in 0..JOINTS {
                (arms[i].q[k], arms[i].qd[k]) = (L::c(self.arms[i].q[k]), L::c(self.arms[i].qd[k]));
            }
        }
        let (mut six, mut disturbance) = ([[L::zero(); 6]; 4], [L::zero(); 6]);
        for k in 0..6 {
            disturbance[k] = L::c(self.disturbance[k]);
            for part in 0..4 {
                six[part][k] = x[6 * part + k];
            }
        }
        let [error, twist, thrust, command] = [six[0], six[1], six[2], six[3]];
        let from = VehicleMotion { error: Lanes6::from_array(error), twist: Lanes6::from_array(twist) };
        let wrenches = AppliedWrenches {
            command: Lanes6::from_array(command),
            thrust: Lanes6::from_array(thrust),
            disturbance: Lanes6::from_array(disturbance),
        };
        let end = self.model.predict(&from, [&arms[0], &arms[1]], &wrenches, self.period, &mut Scratch::new());
        let mut state = [L::zero(); STATES];
        state[..6].copy_from_slice(&end.motion.error.to_array());
        state[6..12].copy_from_slice(&end.motion.twist.to_array());
        state[12..].copy_from_slice(&end.thrust.to_array());
        state
    }
}

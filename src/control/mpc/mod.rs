//! Linear model-predictive control.

mod gains;
pub mod model;

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus};
use nalgebra::{Cholesky, DMatrix, DVector, Vector6};

use super::ActionMap;
use super::observer::{Estimate, Observer};
use crate::description::Scene;
use crate::dynamics::CompositeBody;
use crate::lane::Lane;
pub use gains::MpcGains;
use model::{LinearModel, MOVES};

/// Parameters of a plan: pose error, twist, wrench of the thrusters, previous command; then the steady external wrench,
/// the wave wrench and its rate. Six each.
pub const PARAMETERS: usize = 42;
/// Entries of a plan.
pub const PLAN: usize = 6 * MOVES.len();

/// Model-predictive control: the plan of the wrench over the next 15 control periods, held over 1, 2, 4 and 8 of them,
/// of minimum cost within the thrusters' limits.
///
/// The cost sums the squares of pose errors (1 rad as 0.5 m), of velocities, and, over its limits, of the wrench beyond
/// the compensation of disturbances and of its changes; beyond the plan, the cost of linear feedback without limits. The
/// model is linear: nominal inertia with the arm at home, thrusters through their lag, and the observer's estimate of the
/// disturbance with its waves. A plan without limits that keeps within them is optimal; otherwise a quadratic program is
/// solved. `[Clarabel]`
#[derive(Debug, Clone, PartialEq)]
pub struct Mpc {
    gains: MpcGains,
    /// Maximum wrench along each axis alone: unit of plans.
    pub unit: [f64; 6],
    /// Hessian of the cost: by plan, and by plan and parameters.
    hessian: DMatrix<f64>,
    pub cross: DMatrix<f64>,
    /// Plan without limits per parameter.
    pub gain: DMatrix<f64>,
    /// Thrusts of a wrench in units, over their limits on either side: rows are at most 1.
    pub bounds: DMatrix<f64>,
}

impl Mpc {
    pub fn new(gains: MpcGains, scene: &Scene, observer: &Observer, actions: &ActionMap) -> Self {
        let allocation = actions.allocation();
        let unit = allocation.wrench_limits();
        let model = LinearModel::new(observer.plant(), &scene.home(), unit, &gains, observer.period());
        let column = |k: usize| {
            let (mut plan, mut parameters) = ([0.0; PLAN], [0.0; PARAMETERS]);
            if k < PLAN {
                plan[k] = 1.0
            } else {
                parameters[k - PLAN] = 1.0
            }
            DVector::from_vec(model.residuals(&plan, &parameters))
        };
        let all = DMatrix::from_columns(&(0..PLAN + PARAMETERS).map(column).collect::<Vec<_>>());
        let (by_plan, by_parameters) = (all.columns(0, PLAN), all.columns(PLAN, PARAMETERS));
        let (hessian, cross) = (by_plan.tr_mul(&by_plan), by_plan.tr_mul(&by_parameters));
        let gain = match Cholesky::new(hessian.clone()) {
            Some(factor) => -factor.solve(&cross),
            None => DMatrix::zeros(PLAN, PARAMETERS),
        };
        let mut bounds = DMatrix::zeros(2 * allocation.count(), 6);
        for i in 0..allocation.count() {
            let thrust = allocation.pseudo_inverse(i).component_mul(&Vector6::from(unit));
            for (side, limit) in allocation.limits(i).into_iter().enumerate() {
                // A thruster that cannot push one way gets a bound of rounding size there.
                let limit = if limit.abs() > 1e-6 * allocation.range(i) { limit } else { 1e-6 * allocation.range(i) };
                let sign = if side == 0 { -1.0 } else { 1.0 };
                bounds.row_mut(2 * i + side).copy_from(&(thrust * (sign / limit.abs())).transpose());
            }
        }
        Self { gains, unit, hessian, cross, gain, bounds }
    }

    pub fn gains(&self) -> &MpcGains {
        &self.gains
    }

    /// The first wrench of the optimal plan.
    pub fn plan(&self, parameters: &DVector<f64>) -> Vector6<f64> {
        let mut plan = &self.gain * parameters;
        let within = (0..MOVES.len()).all(|k| (&self.bounds * plan.rows(6 * k, 6)).max() <= 1.0);
        let finite = parameters.iter().all(|x| x.is_finite());
        if !within
            && finite
            && let Some(best) = self.solve(&(&self.cross * parameters))
        {
            plan = best;
        }
        Vector6::from_fn(|k, _| plan[k] * self.unit[k])
    }

    /// The plan of minimum cost within the limits, by the cost's gradient at the zero plan.
    pub fn solve(&self, gradient: &DVector<f64>) -> Option<DVector<f64>> {
        let rows = self.bounds.nrows();
        let mut upper = (Vec::new(), Vec::new(), vec![0]);
        for k in 0..PLAN {
            upper.0.extend((0..=k).map(|i| self.hessian[(i, k)]));
            upper.1.extend(0..=k);
            upper.2.push(upper.0.len());
        }
        let mut limits = (Vec::new(), Vec::new(), vec![0]);
        for k in 0..PLAN {
            let first = k / 6 * rows;
            limits.0.extend((0..rows).map(|i| self.bounds[(i, k % 6)]));
            limits.1.extend(first..first + rows);
            limits.2.push(limits.0.len());
        }
        let count = MOVES.len() * rows;
        let upper = CscMatrix::new(PLAN, PLAN, upper.2, upper.1, upper.0);
        let limits = CscMatrix::new(count, PLAN, limits.2, limits.1, limits.0);
        let cones = [NonnegativeConeT(count)];
        let settings = DefaultSettings { verbose: false, max_iter: 50, ..DefaultSettings::default() };
        let right = vec![1.0; count];
        let mut solver = DefaultSolver::new(&upper, gradient.as_slice(), &limits, &right, &cones, settings).ok()?;
        solver.solve();
        let solved = matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
        solved.then(|| DVector::from_column_slice(&solver.solution.x))
    }
}

/// Parameters of the plan in lanes, for an estimate and the composite bodies at it and a control period (s) later.
#[inline(always)]
pub(super) fn parameters<L: Lane<Real = f64>>(
    at: &Estimate<L>,
    [now, next]: &[CompositeBody<L>; 2],
    period: f64,
) -> [[L; 6]; PARAMETERS / 6] {
    let Estimate { motion, command, thrust, disturbance, .. } = *at;
    // The arm's momentum keeps changing at its present rate.
    let steady = now.momentum.scale_add(L::c(1.0 / period), disturbance.slow);
    let steady = steady + now.force - now.momentum_transport(motion.twist);
    let steady = next.momentum.scale_add(L::c(-1.0 / period), steady);
    [
        motion.error.to_array(),
        motion.twist.to_array(),
        thrust.to_array(),
        command.to_array(),
        steady.to_array(),
        disturbance.wave[0].to_array(),
        disturbance.wave[1].to_array(),
    ]
}

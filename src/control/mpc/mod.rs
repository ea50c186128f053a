//! Linear model-predictive control.

mod gains;
pub mod model;

use nalgebra::{Cholesky, DMatrix, DVector, Vector6};

use super::ActionMap;
use super::observer::{Observer, ObserverEstimate};
use super::thrusts::RelativeThrusts;
use crate::description::Scene;
use crate::dynamics::CompositeBody;
use crate::lane::Lane;
use crate::optimize::minimise;
pub use gains::MpcGains;
use model::{LinearModel, MOVES};

/// Parameters of a plan: pose error, twist, wrench of the thrusters, previous command; then the steady external wrench,
/// the wave wrench and its rate. Six each.
pub const PARAMETERS: usize = 42;
/// Weight on relative thrusts, m2: a cost of thrusts whose wrench is along no actuated axis.
const MIN_THRUST: f64 = 1e-12;

/// Model-predictive control: the plan of the thrusts over the next 15 control periods, constant over 1, 2, 4 and 8 of them,
/// of minimum cost within the thrusters' limits.
///
/// The cost sums the squares of pose errors (1 rad as 0.5 m), of velocities, and, over its limits, of the wrench beyond
/// the compensation of disturbances and of its changes; beyond the plan, the cost of linear feedback without limits. Thrusts that
/// cancel each other cost, too. The model is linear: nominal inertia with the arm at home, thrusters through their lag, and the
/// observer's estimate of the disturbance with its waves. A plan without limits that keeps within them is optimal; otherwise a
/// quadratic program with bounds is solved. `[TMT14]`
#[derive(Debug, Clone, PartialEq)]
pub struct Mpc {
    /// Relative thrusts; a plan has one set for each move.
    pub thrusts: RelativeThrusts,
    /// Hessian of the cost: by plan, and by plan and parameters.
    pub hessian: DMatrix<f64>,
    /// Hessian by plan and parameters.
    pub cross: DMatrix<f64>,
    /// Plan without limits per parameter.
    pub gain: DMatrix<f64>,
    /// Minimum and maximum plan.
    pub bounds: [DVector<f64>; 2],
}

impl Mpc {
    /// For a checked scene.
    pub fn new(gains: &MpcGains, scene: &Scene, observer: &Observer, actions: &ActionMap) -> Self {
        let (thrusts, unit) = (RelativeThrusts::new(actions.allocation()), actions.allocation().wrench_limits());
        let model = LinearModel::new(observer.model(), &scene.home(), unit, gains, observer.period());
        let (moves, m) = (MOVES.len(), thrusts.count());
        let plan = 6 * moves;
        let by_wrenches = model.hessian();
        let mut wrenches = DMatrix::zeros(plan, moves * m);
        let mut hessian = DMatrix::identity(moves * m, moves * m) * MIN_THRUST;
        let cancelling = thrusts.cancelling_root(gains.effort.iter().chain(&gains.change));
        for k in 0..moves {
            wrenches.view_mut((6 * k, m * k), (6, m)).copy_from(&thrusts.wrench);
            let mut block = hessian.view_mut((m * k, m * k), (m, m));
            block += cancelling.tr_mul(&cancelling);
        }
        hessian += wrenches.tr_mul(&(by_wrenches.view((0, 0), (plan, plan)) * &wrenches));
        let cross = wrenches.tr_mul(&by_wrenches.view((0, plan), (plan, PARAMETERS)));
        let gain = match Cholesky::new(hessian.clone()) {
            Some(factor) => -factor.solve(&cross),
            None => DMatrix::zeros(moves * m, PARAMETERS),
        };
        let bounds = [0, 1].map(|side| DVector::from_fn(moves * m, |k, _| thrusts.bounds[side][k % m]));
        Self { thrusts, hessian, cross, gain, bounds }
    }

    /// Plan of minimum cost within the limits.
    pub fn best(&self, parameters: &DVector<f64>) -> DVector<f64> {
        let free = &self.gain * parameters;
        let [lower, upper] = &self.bounds;
        let within = free.iter().zip(lower).zip(upper).all(|((x, lower), upper)| lower <= x && x <= upper);
        if within || !parameters.iter().all(|x| x.is_finite()) {
            return free;
        }
        minimise(&self.hessian, &(&self.cross * parameters), lower, upper).map_or(free, |minimum| minimum.x)
    }

    /// The first wrench of the optimal plan.
    pub fn plan(&self, parameters: &DVector<f64>) -> Vector6<f64> {
        let first = &self.thrusts.wrench * self.best(parameters).rows(0, self.thrusts.count());
        Vector6::from_column_slice(first.as_slice())
    }
}

/// Parameters of the plan in lanes and the slow disturbance, for an estimate and the composite bodies at it and a control period
/// (s) later.
#[inline(always)]
pub(super) fn parameters<L: Lane<Real = f64>>(
    at: &ObserverEstimate<L>,
    [now, next]: &[CompositeBody<L>; 2],
    period: f64,
) -> [[L; 6]; PARAMETERS / 6 + 1] {
    let ObserverEstimate { motion, command, thrust, disturbance, .. } = *at;
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
        disturbance.slow.to_array(),
    ]
}

//! Linear model-predictive control.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus};
use nalgebra::{Cholesky, DMatrix, DVector, Matrix6, Vector6};

use super::filter::Swell;
use super::observer::{Estimate, Observer, Observing};
use super::plant::{Plant, fading};
use super::rows::{ModelIndices, ask, forget, load, reached, rows_of, store};
use crate::control::pd::check_gains;
use crate::control::{ActionMap, Actuation, Controller, Widths};
use crate::description::Scene;
use crate::dynamics::aba::Scratch;
use crate::error::ControlError;
use crate::lane::{Isa, Kernel, Lane, Real};
use crate::system::Joints;

/// Control periods for which each of the wrenches that are planned holds.
const MOVES: [usize; 4] = [1, 2, 4, 8];
/// Control periods after which what the plan leaves is counted as at its end.
const TAIL: usize = 200;
/// An angle of 1 rad counts as this way, m.
const METRES_PER_RADIAN: f64 = 0.5;

/// Parameters of a plan: pose error, twist, wrench of the thrusters, wrench asked for before; then the steady wrench that
/// acts besides, the one that comes and goes, and its rate. Six each.
const PARAMETERS: usize = 42;
const PLAN: usize = 6 * MOVES.len();

/// Weights of [`Mpc`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MpcGains {
    /// On velocities, linear and angular: (m / (m/s))^2, where 1 rad counts as 0.5 m.
    pub velocity: [f64; 2],
    /// On the wrench that is not needed against what disturbs, forces and moments, over its limits, m2.
    pub effort: [f64; 2],
    /// On its change from one move to the next, likewise.
    pub change: [f64; 2],
    /// What it observes by.
    pub observing: Observing,
}

impl MpcGains {
    /// Such as suit most vehicles.
    pub fn usual(observing: Observing) -> Self {
        Self { velocity: [0.02; 2], effort: [0.03, 0.06], change: [0.01, 0.02], observing }
    }
}

/// Model-predictive control: of all plans of the wrench over the next 15 control periods, held over 1, 2, 4 and 8 of them,
/// the one that costs least within the thrusters' limits.
///
/// It costs the squares of pose errors (1 rad for 0.5 m), of velocities, and, over its limits, of the wrench that is not
/// needed against what disturbs and of its changes; beyond the plan as linear feedback without limits would. The model is
/// linear: nominal inertia with the arm at home, thrusters through their lag, and what acts besides by the observer's
/// estimate, which comes and goes with its waves. Where the plan without limits keeps within them it is the best; else a
/// quadratic program tells. `[Clarabel]`
#[derive(Debug, Clone, PartialEq)]
pub struct Mpc {
    gains: MpcGains,
    reading: ModelIndices,
    observer: Observer,
    actions: ActionMap,
    actuation: Actuation<f64>,
    /// Greatest wrench along each axis alone: unit of plans.
    unit: [f64; 6],
    /// Hessian of the cost by plan; by plan and parameters; and what the plan without limits makes of parameters.
    hessian: DMatrix<f64>,
    cross: DMatrix<f64>,
    gain: DMatrix<f64>,
    /// Thrusts of a wrench in units, over their limits on either side: rows are at most 1.
    bounds: DMatrix<f64>,
}

/// The linear model and the roots of the weights.
struct Model {
    inverse: Matrix6<f64>,
    period: f64,
    /// Of the thrusters' lag over a period.
    kept: f64,
    mean: f64,
    unit: [f64; 6],
    pose: Vector6<f64>,
    velocity: Vector6<f64>,
    effort: Vector6<f64>,
    change: Vector6<f64>,
    /// Cost beyond the plan, factored, by pose error, twist, and wrench that is not needed.
    tail: DMatrix<f64>,
    frequency: f64,
}

/// Six numbers out of many.
fn six(from: &[f64], k: usize) -> Vector6<f64> {
    Vector6::from_column_slice(&from[6 * k..6 * k + 6])
}

impl Model {
    fn new(plant: &Plant, home: &Joints, unit: [f64; 6], gains: &MpcGains, period: f64) -> Self {
        let inertia = plant.inertia(home);
        let (kept, mean) = fading(period, plant.lag());
        let pushes = unit.map(|limit| limit > 0.0);
        let root = |k: usize, weight: f64| if pushes[k] { weight.sqrt() } else { 0.0 };
        let way = |k: usize| if k < 3 { 1.0 } else { METRES_PER_RADIAN };
        let all = |weights: [f64; 2]| Vector6::from_fn(|k, _| root(k, weights[k / 3]));
        let mut model = Self {
            // It is positive definite.
            inverse: inertia.try_inverse().unwrap_or_else(Matrix6::zeros),
            period,
            kept,
            mean,
            unit,
            pose: Vector6::from_fn(|k, _| root(k, 1.0) * way(k)),
            velocity: all(gains.velocity).component_mul(&Vector6::from_fn(|k, _| way(k))),
            effort: all(gains.effort),
            change: all(gains.change),
            tail: DMatrix::zeros(18, 18),
            frequency: gains.observing.frequency,
        };
        model.tail = model.cost_to_go();
        model
    }

    /// A control period: pose error, twist and thrusters' wrench under a wrench that acts besides and one that is asked for.
    fn step(&self, state: &mut [Vector6<f64>; 3], besides: Vector6<f64>, asked: Vector6<f64>) {
        let [error, twist, thrust] = *state;
        let acceleration = self.inverse * (asked + (thrust - asked) * self.mean + besides);
        let t = self.period;
        *state = [
            error + twist * t + acceleration * (0.5 * t * t),
            twist + acceleration * t,
            asked + (thrust - asked) * self.kept,
        ];
    }

    fn units(&self, wrench: Vector6<f64>) -> Vector6<f64> {
        wrench.component_mul(&Vector6::from(self.unit))
    }

    fn over_units(&self, wrench: Vector6<f64>) -> Vector6<f64> {
        Vector6::from_fn(|k, _| if self.unit[k] > 0.0 { wrench[k] / self.unit[k] } else { 0.0 })
    }

    /// A root of what linear feedback costs from a state on: of its Riccati equation.
    fn cost_to_go(&self) -> DMatrix<f64> {
        let (mut a, mut b) = (DMatrix::zeros(18, 18), DMatrix::zeros(18, 6));
        for column in 0..24 {
            let mut x = [0.0; 24];
            x[column] = 1.0;
            let mut state = [six(&x, 0), six(&x, 1), six(&x, 2)];
            self.step(&mut state, Vector6::zeros(), self.units(six(&x, 3)));
            let after = DVector::from_iterator(18, state.iter().flat_map(|part| part.iter().copied()));
            if column < 18 { a.set_column(column, &after) } else { b.set_column(column - 18, &after) }
        }
        let mut weight = DMatrix::zeros(18, 18);
        let mut price = DMatrix::identity(6, 6);
        for k in 0..6 {
            weight[(k, k)] = self.pose[k].powi(2);
            weight[(6 + k, 6 + k)] = self.velocity[k].powi(2);
            if self.unit[k] > 0.0 {
                price[(k, k)] = self.effort[k].powi(2).max(LEAST_PRICE);
            }
        }
        let mut cost = weight.clone();
        for _ in 0..TAIL {
            let cost_b = &cost * &b;
            let Some(inverse) = (&price + b.tr_mul(&cost_b)).try_inverse() else { break };
            let feedback = inverse * cost_b.tr_mul(&a);
            let closed = &a - &b * &feedback;
            cost = &weight + closed.tr_mul(&(&cost * &closed)) + feedback.tr_mul(&(&price * &feedback));
            cost = (&cost + cost.transpose()) * 0.5;
        }
        let eigen = cost.symmetric_eigen();
        let roots = eigen.eigenvalues.map(|x| x.max(0.0).sqrt());
        DMatrix::from_diagonal(&roots) * eigen.eigenvectors.transpose()
    }

    /// Roots of all that a plan costs; linear in plan and parameters.
    fn residuals(&self, plan: &[f64], parameters: &[f64]) -> Vec<f64> {
        let mut state = [six(parameters, 0), six(parameters, 1), six(parameters, 2)];
        let [mut last, steady, wave, rate] = [3, 4, 5, 6].map(|k| six(parameters, k));
        let (mut all, mut time) = (Vec::new(), 0.0);
        let mut besides = steady;
        for (k, periods) in MOVES.into_iter().enumerate() {
            let share = six(plan, k);
            let asked = self.units(share);
            // An axis that nothing pushes along takes no part.
            all.extend((0..6).filter(|&k| self.unit[k] == 0.0).map(|k| share[k]));
            all.extend(self.change.component_mul(&self.over_units(asked - last)).iter());
            last = asked;
            for _ in 0..periods {
                let Swell([[a, b], _]) = Swell::over(self.frequency, time + 0.5 * self.period);
                besides = steady + wave * a + rate * b;
                let effort = self.effort.map(|root| root.max(LEAST_PRICE.sqrt()));
                all.extend(effort.component_mul(&self.over_units(asked + besides)).iter());
                self.step(&mut state, besides, asked);
                time += self.period;
                all.extend(self.pose.component_mul(&state[0]).iter());
                all.extend(self.velocity.component_mul(&state[1]).iter());
            }
        }
        let end = DVector::from_iterator(18, state[0].iter().chain(&state[1]).chain(&(state[2] + besides)).copied());
        all.extend((&self.tail * end).iter());
        all
    }
}

/// Least weight on effort: without any there is no least cost.
const LEAST_PRICE: f64 = 1e-8;

impl Mpc {
    /// For a checked scene, acting every `period` s.
    ///
    /// # Errors
    /// `ControlError::Gain` for a weight that is not finite or is negative.
    pub fn new(
        gains: MpcGains,
        reading: ModelIndices,
        scene: &Scene,
        actions: ActionMap,
        period: f64,
    ) -> Result<Self, ControlError> {
        check_gains("velocity", &gains.velocity)?;
        check_gains("effort", &gains.effort)?;
        check_gains("change", &gains.change)?;
        let observer = Observer::new(gains.observing, 0.0, scene, period)?;
        let allocation = actions.allocation();
        let unit = allocation.wrench_limits();
        let model = Model::new(observer.plant(), &scene.home(), unit, &gains, period);
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
                // A thruster that does not push one way is not asked to, but for rounding.
                let limit = if limit.abs() > 1e-6 * allocation.range(i) { limit } else { 1e-6 * allocation.range(i) };
                let sign = if side == 0 { -1.0 } else { 1.0 };
                bounds.row_mut(2 * i + side).copy_from(&(thrust * (sign / limit.abs())).transpose());
            }
        }
        let actuation = Actuation::new(&actions);
        Ok(Self { gains, reading, observer, actuation, actions, unit, hessian, cross, gain, bounds })
    }

    /// Weights in use.
    pub fn gains(&self) -> &MpcGains {
        &self.gains
    }

    /// The first wrench of the best plan.
    fn plan(&self, parameters: &DVector<f64>) -> Vector6<f64> {
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

    /// The plan of least cost within the limits, by the cost's gradient where there is no plan.
    fn solve(&self, gradient: &DVector<f64>) -> Option<DVector<f64>> {
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

    /// Parameters of the plan, for each lane.
    #[inline(always)]
    fn parameters<L: Lane<Real = f64>>(&self, at: &Estimate<L>, scratch: &mut Scratch<L>) -> [[L; 6]; PARAMETERS / 6] {
        let Estimate { motion, arms, command, thrust, unexplained } = *at;
        let mut steady = unexplained.drift;
        // The arm goes on as it does.
        for (arm, share) in arms.iter().zip([1.0, -1.0]) {
            let here = self.observer.plant().whole(&motion, arm, scratch);
            steady = here.momentum.scale_add(L::c(share / self.observer.period()), steady);
            if share > 0.0 {
                steady = steady + here.force - here.momentum_transport(motion.twist);
            }
        }
        [
            motion.error.to_array(),
            motion.twist.to_array(),
            thrust.to_array(),
            command.to_array(),
            steady.to_array(),
            unexplained.wave[0].to_array(),
            unexplained.wave[1].to_array(),
        ]
    }
}

impl Controller for Mpc {
    fn widths(&self) -> Widths {
        Widths { observation: self.reading.vehicle.width, memory: self.observer.memory(), action: self.actions.len() }
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().rows(observations, memory, actions)?;
        f64::dispatch(Isa::best().unwrap_or(Isa::Plain), &mut Rows { control: self, observations, memory, actions });
        Ok(())
    }
}

struct Rows<'a> {
    control: &'a Mpc,
    observations: &'a [f32],
    memory: &'a mut [f64],
    actions: &'a mut [f32],
}

impl Kernel<f64> for Rows<'_> {
    #[inline(always)]
    fn run<L: Lane<Real = f64>>(&mut self) {
        let Mpc { observer, reading, actions: map, actuation, .. } = self.control;
        let Widths { observation, memory: width, action } = self.control.widths();
        let mut scratch = Scratch::new();
        let mut memory = vec![L::zero(); width];
        let groups = self.observations.chunks(L::LANES * observation);
        let groups =
            groups.zip(self.memory.chunks_mut(L::LANES * width)).zip(self.actions.chunks_mut(L::LANES * action));
        for ((rows, remembered), actions) in groups {
            load(remembered, width, &mut memory);
            let seen = reading.read::<L>(rows);
            let estimate = observer.observe(&seen, &mut memory, &mut scratch);
            let parameters = rows_of(&self.control.parameters(&estimate, &mut scratch));
            for (parameters, action) in parameters.iter().zip(actions.chunks_exact_mut(action)) {
                let parameters = DVector::from_column_slice(parameters.as_flattened());
                ask(map, &self.control.plan(&parameters), action);
            }
            observer.remember(&seen, reached(actuation, actions), &mut memory);
            store(&memory, remembered, width);
            forget(remembered, width);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::control::{ActionKind, Allocation, BlockIndices, ObservationIndices};

    fn mpc(name: &str) -> Mpc {
        let scene = Scene::shipped(name).unwrap();
        let none = || BlockIndices::default();
        let vehicle = ObservationIndices { width: 12, error: [(0, 1.0); 6], twist: [(0, 1.0); 6] };
        let reading = ModelIndices { vehicle, arm: [none(), none()], reference: [none(), none()], home: Vec::new() };
        let actions = ActionMap::new(ActionKind::Wrench, Allocation::new(&scene.vehicle).unwrap(), Vec::new());
        let observing = Observing { observer: [2.0; 2], waves: [0.0; 2], frequency: 1.0, jolts: [0.0; 2], delay: 0 };
        Mpc::new(MpcGains::usual(observing), reading, &scene, actions, 0.1).unwrap()
    }

    fn model(mpc: &Mpc, name: &str) -> Model {
        let scene = Scene::shipped(name).unwrap();
        Model::new(mpc.observer.plant(), &scene.home(), mpc.unit, &mpc.gains, 0.1)
    }

    fn cost(model: &Model, plan: &DVector<f64>, parameters: &DVector<f64>) -> f64 {
        model.residuals(plan.as_slice(), parameters.as_slice()).iter().map(|x| x * x).sum()
    }

    /// Errors up to 1 m and 1 rad, speeds up to 0.5, wrenches up to 100.
    fn parameters() -> impl Strategy<Value = DVector<f64>> {
        prop::collection::vec(-1.0..1.0f64, PARAMETERS).prop_map(|mut all| {
            all[6..12].iter_mut().for_each(|x| *x *= 0.5);
            all[12..].iter_mut().for_each(|x| *x *= 100.0);
            DVector::from_vec(all)
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

        #[test]
        fn no_plan_within_the_limits_costs_less(
            name in prop::sample::select(vec!["petasus-pum", "bluerov2-heavy", "bluerov2-heavy-alpha5"]),
            parameters in parameters(),
            other in prop::collection::vec(-1.0..1.0f64, PLAN),
        ) {
            let mpc = mpc(name);
            let model = model(&mpc, name);
            let free = &mpc.gain * &parameters;
            let best = mpc.solve(&(&mpc.cross * &parameters)).unwrap();
            let over = |plan: &DVector<f64>| {
                (0..MOVES.len()).map(|k| (&mpc.bounds * plan.rows(6 * k, 6)).max()).fold(0.0, f64::max)
            };
            prop_assert!(over(&best) < 1.0 + 1e-6, "{}", over(&best));
            let least = cost(&model, &best, &parameters);
            prop_assert!(cost(&model, &free, &parameters) <= least * (1.0 + 1e-9));
            if over(&free) < 0.99 {
                prop_assert!((&free - &best).amax() < 1e-4, "{}", (&free - &best).amax());
            }
            for plan in [free, DVector::from_vec(other), DVector::zeros(PLAN)] {
                let plan = &plan / over(&plan).max(1.0);
                prop_assert!(least <= cost(&model, &plan, &parameters) * (1.0 + 1e-6) + 1e-9);
                // On the way there, too.
                let near = &best + (plan - &best) * 1e-3;
                prop_assert!(least <= cost(&model, &near, &parameters) * (1.0 + 1e-6) + 1e-9);
            }
        }
    }

    #[test]
    fn at_rest_on_target_the_plan_is_to_hold_against_what_disturbs() {
        let mpc = mpc("petasus-pum");
        let mut parameters = DVector::zeros(PARAMETERS);
        let besides = [20.0, -10.0, 15.0, 2.0, -3.0, 1.0];
        for k in 0..6 {
            (parameters[12 + k], parameters[18 + k], parameters[24 + k]) = (-besides[k], -besides[k], besides[k]);
        }
        let wrench = mpc.plan(&parameters);
        assert!((wrench + Vector6::from(besides)).amax() < 1e-6, "{wrench}");
    }
}

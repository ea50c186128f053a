//! End-effector tracking: the plan of thrusts and torques that follow the reference.

use nalgebra::{DMatrix, DVector, Vector6};

use super::gains::NmpcGains;
use super::real_time::{Cost, RealTimePlan};
use super::tracking_model::{PlanLayout, TrackingModel};
use crate::control::bank::Bank;
use crate::control::controller::{Controller, Plant, Widths};
use crate::control::indices::ATTITUDE_LEVER;
use crate::control::nominal_model::NominalModel;
use crate::control::resolved_motion::{MotionBank, MotionEstimates, Predictor, TrackingIndices, reached};
use crate::control::thrusts::MIN_EFFORT;
use crate::control::{ActionMap, Actuation};
use crate::error::ControlError;

/// Control periods of a plan.
const HORIZON: usize = 10;
/// Weight on the pose error at a plan's end, relative to a knot's.
const END: f64 = 5.0;

/// Nonlinear model-predictive control of vehicle and arm: the plan of thrusts and joint torques over the next
/// [`HORIZON`] control periods, improved by one real-time iteration in each.
///
/// Model, disturbance observer and prediction of the present are shared with
/// [`ResolvedMotion`](crate::control::ResolvedMotion); the points of the reference that are observed ahead are met at
/// their times.
pub struct TrackingNmpc {
    indices: TrackingIndices,
    actions: ActionMap,
    actuation: Actuation<f64>,
    model: NominalModel,
    bank: MotionBank,
    home: Vec<f64>,
    layout: PlanLayout,
    bounds: [DVector<f64>; 2],
    cost: Cost,
}

impl TrackingNmpc {
    /// For checked gains.
    pub fn new(gains: &NmpcGains, indices: TrackingIndices, plant: Plant) -> Self {
        let Plant { scene, actions, period } = plant;
        let (layout, model) = (PlanLayout::new(&actions), NominalModel::new(scene));
        let predictor = Predictor::new(&gains.predictor(), &model, &actions, period);
        let roots = roots(&layout, gains, &actions.allocation().wrench_limits());
        let hessian = roots.tr_mul(&roots);
        let mut end = hessian.view((0, 0), (layout.states(), layout.states())).into_owned();
        end.view_mut((0, 0), (6, 6)).scale_mut(END);
        Self {
            bank: MotionBank::new(Bank::alike(gains.delay, 1), predictor),
            bounds: layout.bounds(),
            model,
            home: scene.joints().map(|joint| joint.home).collect(),
            actuation: Actuation::new(&actions),
            cost: Cost { hessian, end },
            indices,
            actions,
            layout,
        }
    }

    /// Numbers of memory per instance: the plan's relative thrusts and torques.
    fn plan_memory(&self) -> usize {
        HORIZON * self.layout.inputs()
    }

    /// One action, and the memory that follows.
    fn control(&self, observation: &[f32], memory: &mut [f64], action: &mut [f32]) {
        let (memory, plan) = memory.split_at_mut(self.bank.memory());
        let (inputs, estimates) = self.at(observation, memory, |model| {
            let (targets, dynamics) = (self.targets(model), model.dynamics());
            let from = RealTimePlan::new(model, (&self.cost, &dynamics), &targets, &self.bounds, model.present(), plan);
            from.improve(plan)
        });
        let effort = self.layout.effort(&inputs);
        let wrench = effort.fixed_rows::<6>(0).into_owned();
        self.actions.normalise(&wrench, &effort.as_slice()[6..6 + self.layout.joints], action);
        let reached = reached(&self.actuation, action);
        self.bank.remember(estimates, &reached, memory);
    }

    /// Evaluates `work` with the model from the present of an observation on, and returns the estimates of the present too.
    pub(super) fn at<T>(
        &self,
        observation: &[f32],
        memory: &mut [f64],
        work: impl FnOnce(&TrackingModel) -> T,
    ) -> (T, MotionEstimates) {
        let measured = self.indices.read(&self.home, observation);
        let points = self.indices.points(&measured.error, observation);
        let estimates = self.bank.estimate(&self.model, &measured, memory);
        let (estimate, equations) = estimates.likeliest();
        let rates = self.reference_rates(&measured.reference, &points);
        let (layout, model, bank) = (&self.layout, &self.model, &self.bank);
        (work(&TrackingModel { layout, model, bank, estimate, equations, rates: &rates }), estimates)
    }

    /// Evaluates `work` with the model from an observation on that is the first of its episode.
    pub fn at_first<T>(&self, observation: &[f32], work: impl FnOnce(&TrackingModel) -> T) -> T {
        self.at(observation, &mut vec![0.0; self.bank.memory()], work).0
    }

    /// Mean twist of the reference in each control period: of constant acceleration to the first point ahead, of
    /// constant velocity from point to point, and beyond the last.
    fn reference_rates(&self, twist: &Vector6<f64>, (points, spacing): &(Vec<Vector6<f64>>, f64)) -> Vec<Vector6<f64>> {
        let period = self.bank.predictor.period;
        let at = |time: f64| -> Vector6<f64> {
            let Some(first) = points.first() else { return twist * time };
            if time <= *spacing {
                return twist * time + (first - twist * *spacing) * (time / spacing).powi(2);
            }
            let k = ((time / spacing) as usize).min(points.len() - 1).max(1);
            if points.len() == 1 {
                return first + (first * (2.0 / spacing) - twist) * (time - spacing);
            }
            points[k - 1] + (points[k] - points[k - 1]) * (time / spacing - k as f64)
        };
        (0..HORIZON).map(|k| (at((k + 1) as f64 * period) - at(k as f64 * period)) / period).collect()
    }

    /// z of each knot that costs nothing.
    fn targets(&self, model: &TrackingModel) -> Vec<DVector<f64>> {
        let (layout, n) = (&self.layout, self.layout.joints);
        let hold = model.holding_effort();
        let mut target = DVector::zeros(layout.states() + layout.inputs());
        target[8] = 1.0;
        (0..n).for_each(|k| target[9 + k] = self.home[k]);
        target.rows_mut(layout.thrust(), 6).copy_from(&hold.fixed_rows::<6>(0));
        target.rows_mut(layout.states(), layout.inputs()).copy_from(&layout.relative(&hold));
        let end = target.rows(0, layout.states()).into_owned();
        let mut all = vec![target; HORIZON];
        all.push(end);
        all
    }
}

/// Roots of a knot's cost: rows of weighted residuals of z.
fn roots(layout: &PlanLayout, gains: &NmpcGains, unit: &[f64; 6]) -> DMatrix<f64> {
    let (n, s, w) = (layout.joints, layout.states(), layout.inputs());
    let mut rows = gains.roots(&layout.thrusts, ([true; 6], unit), [layout.velocity(), layout.thrust(), s], s + w);
    let mut add = |k: usize, root: f64| {
        rows.push(DVector::zeros(s + w));
        let last = rows.len() - 1;
        rows[last][k] = root;
    };
    (0..2).for_each(|k| add(6 + k, gains.levelling.sqrt() * ATTITUDE_LEVER));
    for k in 0..n {
        add(9 + k, gains.posture.sqrt() * ATTITUDE_LEVER);
        add(layout.velocity() + 6 + k, gains.velocity[2].sqrt() * ATTITUDE_LEVER);
        add(s + w - n + k, gains.effort[2].max(MIN_EFFORT).sqrt());
    }
    DMatrix::from_columns(&rows).transpose()
}

impl Controller for TrackingNmpc {
    fn widths(&self) -> Widths {
        let memory = self.bank.memory() + self.plan_memory();
        Widths { observation: self.indices.width, memory, action: self.actions.len() }
    }

    fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        let mut layout = self.bank.memory_layout();
        layout.push(("plan", self.plan_memory()));
        layout
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().each_row(observations, memory, actions, |observation, memory, action| {
            self.control(observation, memory, action);
        })
    }
}

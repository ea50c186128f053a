//! End-effector tracking by resolved motion.

mod adaptive;
mod gains;
mod motion_bank;
mod predictor;
mod reading;

use nalgebra::{SMatrix, Vector3, Vector6};

pub use adaptive::AdaptiveMotionGains;
pub use gains::ResolvedMotionGains;
pub(super) use motion_bank::{MotionBank, MotionEstimate, MotionEstimates};
pub(super) use predictor::Predictor;
pub use reading::{TrackingIndices, TrackingState};

use super::bank::Bank;
use super::controller::{Controller, Plant, Widths};
use super::equations::{Equations, VELOCITIES, Velocities};
use super::nominal_model::NominalModel;
use super::{ActionMap, Actuation};
use crate::description::JointLimits;
use crate::error::ControlError;
use crate::system::JOINTS;

/// Share of its travel within which a joint near a limit loses mobility.
const MARGIN: f64 = 0.15;
/// Damping of the pseudo-inverse, as a share of the vehicle's own weight.
const DAMPING: f64 = 1e-3;
/// Share of an actuator's limit beyond which a missing force counts as saturation: actions are rounded to f32.
const MISSED: f64 = 1e-4;

/// Resolved motion and inverse dynamics. `[Whi69]`
///
/// The end effector's commanded twist is the reference's minus `pose_gain` times the pose error and its integral. A damped
/// and weighted pseudo-inverse of its Jacobian distributes it among vehicle and joints; in its null space the arm returns
/// home and the vehicle levels. Inverse dynamics (`[HC eq. 13]`, in still water) turns the error of these velocities and
/// the reference's acceleration into a wrench and torques, clipped to the actuators' limits.
///
/// With `observer_bandwidth` the forces that the model lacks are estimated from the measured velocities, and compensated;
/// with `delay` the law acts on a prediction of the present from delayed measurements. [`Self::adaptive`] has one such
/// observer per model of delay and thrust, and acts by the mean of their laws.
pub struct ResolvedMotion {
    indices: TrackingIndices,
    /// Gains by model.
    gains: Vec<ResolvedMotionGains>,
    actions: ActionMap,
    actuation: Actuation<f64>,
    model: NominalModel,
    /// Control period, s.
    period: f64,
    bank: Option<MotionBank>,
    home: Vec<f64>,
    limits: Vec<Option<JointLimits>>,
    /// 1 for the vehicle's actuated axes, else 0.
    actuated: [f64; 6],
}

impl ResolvedMotion {
    /// For checked gains.
    pub fn new(gains: ResolvedMotionGains, indices: TrackingIndices, plant: Plant) -> Self {
        Self::on_models(Bank::single(gains.delay), vec![gains], indices, plant)
    }

    /// On a bank of models, for checked gains.
    pub fn adaptive(gains: &AdaptiveMotionGains, indices: TrackingIndices, plant: Plant) -> Self {
        let bank = gains.bank(plant.period);
        let models = gains.models(&bank, plant.period);
        Self::on_models(bank, models, indices, plant)
    }

    fn on_models(bank: Bank<3>, gains: Vec<ResolvedMotionGains>, indices: TrackingIndices, plant: Plant) -> Self {
        let Plant { scene, actions, period } = plant;
        let model = NominalModel::new(scene);
        let actuated = actions.allocation().wrench_limits().map(|limit| f64::from(u8::from(limit > 0.0)));
        let (home, limits) = scene.joints().map(|joint| (joint.home, joint.limits.clone())).unzip();
        let needs_bank = gains.len() > 1 || gains[0].predicts();
        let bank = needs_bank.then(|| MotionBank::new(bank, Predictor::new(&gains[0], &model, &actions, period)));
        let actuation = Actuation::new(&actions);
        Self { indices, gains, actions, actuation, model, period, bank, home, limits, actuated }
    }

    /// Commanded accelerations, for an integral of the pose error.
    fn acceleration(
        &self,
        gains: &ResolvedMotionGains,
        now: &TrackingState,
        jacobian: &SMatrix<f64, 6, VELOCITIES>,
        integral: &Vector6<f64>,
    ) -> Option<Velocities> {
        let (n, q) = (self.home.len(), &now.q);
        // Mobilities: inverse weights.
        let mut mobility = Velocities::zeros();
        for k in 0..6 {
            mobility[k] = self.actuated[k];
        }
        for k in 0..n {
            let margin = self.limits[k].as_ref().map_or(1.0, |limits| {
                let room = (q[k] - limits.lower).min(limits.upper - q[k]);
                (room / (MARGIN * (limits.upper - limits.lower))).clamp(0.0, 1.0)
            });
            mobility[6 + k] = gains.arm_weight * margin;
        }
        let mut scaled = jacobian.transpose();
        for k in 0..VELOCITIES {
            scaled.row_mut(k).scale_mut(mobility[k]);
        }
        let damped = jacobian * scaled + SMatrix::<f64, 6, 6>::identity() * DAMPING;
        // Symmetric and positive definite.
        let factor = damped.cholesky()?;
        let distribute = |motion: &Vector6<f64>| scaled * factor.solve(motion);

        let mut secondary = Velocities::zeros();
        // Rotation of the vehicle's z axis to the vertical.
        secondary.fixed_rows_mut::<3>(3).copy_from(&(Vector3::z().cross(&now.up) * gains.levelling_gain));
        for k in 0..n {
            secondary[6 + k] = gains.posture_gain * (self.home[k] - q[k]);
        }
        let error = now.error + integral * gains.integral_gain;
        let command = secondary + distribute(&(now.reference - error * gains.pose_gain - jacobian * secondary));

        let mut acceleration = distribute(&now.acceleration);
        for k in 0..6 + n {
            let gain = if k < 6 { gains.twist_gain } else { gains.joint_gain };
            acceleration[k] += gain * (command[k] - now.velocities[k]);
        }
        Some(acceleration)
    }

    /// Effort without compensation of disturbances and lag.
    fn effort(
        &self,
        gains: &ResolvedMotionGains,
        now: &TrackingState,
        equations: &Equations,
        integral: &Vector6<f64>,
    ) -> Velocities {
        self.acceleration(gains, now, &equations.jacobian, integral)
            .map_or_else(Velocities::zeros, |acceleration| equations.inertia * acceleration + equations.bias)
    }

    /// Number of integrals of the pose error.
    fn integrals(&self) -> usize {
        if self.gains[0].integral_gain > 0.0 { 6 } else { 0 }
    }

    /// One action, and the memory that follows.
    fn control(&self, observation: &[f32], memory: &mut [f64], action: &mut [f32]) {
        let n = self.home.len();
        let mut now = self.indices.read(&self.home, observation);
        let (integral, memory) = memory.split_at_mut(self.integrals());
        let mut sum = Vector6::zeros();
        integral.iter().zip(sum.iter_mut()).for_each(|(z, sum)| *sum = *z);
        let estimates = self.bank.as_ref().map(|bank| (bank, bank.estimate(&self.model, &now, memory)));
        let effort = match &estimates {
            Some((bank, estimates)) => {
                now.error = estimates.likeliest().0.now.error;
                bank.mean(estimates, |k, now, equations| self.effort(&self.gains[k], now, equations, &sum))
            }
            None => self.effort(&self.gains[0], &now, &self.model.equations(now.chain(), 0.0), &sum),
        };
        self.actions.normalise(&effort.fixed_rows::<6>(0).into_owned(), &effort.as_slice()[6..6 + n], action);
        if self.widths().memory == 0 {
            return;
        }
        let reached = reached(&self.actuation, action);
        if !integral.is_empty() {
            let limits = self.actions.allocation().wrench_limits();
            let missed = |k: usize, limit: f64| limit > 0.0 && (effort[k] - reached[k]).abs() > MISSED * limit;
            let saturated = (0..6).any(|k| missed(k, limits[k]))
                || self.actions.torques().iter().enumerate().any(|(k, limit)| missed(6 + k, *limit));
            for (z, error) in integral.iter_mut().zip(&now.error) {
                if !(saturated && *z * error > 0.0) {
                    *z += self.period * error;
                }
            }
        }
        if let Some((bank, estimates)) = estimates {
            bank.remember(estimates, &reached, memory);
        }
    }
}

/// Wrench and torques of an action within the actuators' limits.
pub(super) fn reached(actuation: &Actuation<f64>, action: &[f32]) -> Velocities {
    let actuated = actuation.act_on_row(action);
    let mut reached = Velocities::zeros();
    reached.fixed_rows_mut::<6>(0).copy_from_slice(&actuated.wrench.to_array());
    reached.fixed_rows_mut::<JOINTS>(6).copy_from_slice(&actuated.torques);
    reached
}

impl Controller for ResolvedMotion {
    fn widths(&self) -> Widths {
        let memory = self.integrals() + self.bank.as_ref().map_or(0, MotionBank::memory);
        Widths { observation: self.indices.width, memory, action: self.actions.len() }
    }

    fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        let integral = (self.integrals() > 0).then_some(("integral", 6));
        integral.into_iter().chain(self.bank.iter().flat_map(MotionBank::memory_layout)).collect()
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().each_row(observations, memory, actions, |observation, memory, action| {
            self.control(observation, memory, action);
        })
    }
}

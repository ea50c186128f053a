//! End-effector tracking by resolved motion.

mod adaptive;
mod compliance;
mod gains;
mod hold;
mod motion_bank;
mod predictor;
mod reading;

use nalgebra::{SMatrix, SVector, Vector3, Vector6};

pub use adaptive::AdaptiveMotionGains;
use compliance::displacement;
pub use gains::ResolvedMotionGains;
pub(super) use motion_bank::{MotionBank, MotionEstimate, MotionEstimates};
pub(super) use predictor::Predictor;
pub use reading::{TrackingIndices, TrackingState};

use super::bank::Bank;
use super::controller::{Controller, Plant, Widths};
use super::equations::{Equations, VELOCITIES, Velocities, product};
use super::nominal_model::NominalModel;
use super::{ActionMap, Actuation};
use crate::description::{DEFAULT_END_EFFECTOR, JointLimits, Scene};
use crate::error::ControlError;
use crate::lie::Pose;
use crate::system::{EndEffector, JOINTS};

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
/// with `compliance` the end effector gives way to the force that the observer finds on it;
/// with `hold` further end effectors are held still: their Jacobians and commanded twists, minus `pose_gain` times their
/// own pose errors, are further rows of the same least squares;
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
    ///
    /// # Errors
    /// [`ControlError::GainShape`] if `hold` has a name that is no other end effector's of the scene, or too many.
    pub fn new(gains: ResolvedMotionGains, indices: TrackingIndices, plant: Plant) -> Result<Self, ControlError> {
        Self::on_models(Bank::alike(gains.delay, 1), vec![gains], indices, plant)
    }

    /// On a bank of models, for checked gains.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn adaptive(gains: &AdaptiveMotionGains, indices: TrackingIndices, plant: Plant) -> Result<Self, ControlError> {
        let bank = gains.bank(plant.period);
        let models = gains.models(&bank, plant.period);
        Self::on_models(bank, models, indices, plant)
    }

    fn on_models(
        bank: Bank<3>,
        gains: Vec<ResolvedMotionGains>,
        indices: TrackingIndices,
        plant: Plant,
    ) -> Result<Self, ControlError> {
        let Plant { scene, actions, period } = plant;
        let mut model = NominalModel::new(scene);
        model.held = held(scene, &gains[0].hold)?;
        let actuated = actions.allocation().wrench_limits().map(|limit| f64::from(u8::from(limit > 0.0)));
        let (home, limits) = scene.joints().map(|joint| (joint.home, joint.limits.clone())).unzip();
        let needs_bank = gains.len() > 1 || gains[0].predicts();
        let bank = needs_bank.then(|| MotionBank::new(bank, Predictor::new(&gains[0], &model, &actions, period)));
        let actuation = Actuation::new(&actions);
        Ok(Self { indices, gains, actions, actuation, model, period, bank, home, limits, actuated })
    }

    /// Commanded accelerations, for an offset of the pose error and the targets of held end effectors: with them, ROWS of
    /// commanded twists.
    fn acceleration<const ROWS: usize>(
        &self,
        gains: &ResolvedMotionGains,
        now: &TrackingState,
        equations: &Equations,
        (offset, targets): (&Vector6<f64>, &[Pose<f64>]),
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
        let mut jacobian = SMatrix::<f64, ROWS, VELOCITIES>::zeros();
        for (k, rows) in std::iter::once(&equations.jacobian).chain(&equations.held).enumerate() {
            jacobian.fixed_rows_mut::<6>(6 * k).copy_from(rows);
        }
        let mut scaled = jacobian.transpose();
        for k in 0..VELOCITIES {
            scaled.row_mut(k).scale_mut(mobility[k]);
        }
        let size = 6 + n;
        let mut damped = SMatrix::<f64, ROWS, ROWS>::zeros();
        for k in 0..ROWS {
            damped.set_column(k, &product(&jacobian, &scaled.column(k).into_owned(), size));
        }
        damped += SMatrix::identity() * DAMPING;
        // Symmetric and positive definite.
        let factor = damped.cholesky()?;
        let distribute = |motion: &SVector<f64, ROWS>| scaled * factor.solve(motion);

        let mut secondary = Velocities::zeros();
        // Rotation of the vehicle's z axis to the vertical.
        secondary.fixed_rows_mut::<3>(3).copy_from(&(Vector3::z().cross(&now.up) * gains.levelling_gain));
        for k in 0..n {
            secondary[6 + k] = gains.posture_gain * (self.home[k] - q[k]);
        }
        let error = now.error + offset;
        let (mut twist, mut rate) = (SVector::<f64, ROWS>::zeros(), SVector::<f64, ROWS>::zeros());
        twist.fixed_rows_mut::<6>(0).copy_from(&(now.reference - error * gains.pose_gain));
        rate.fixed_rows_mut::<6>(0).copy_from(&now.acceleration);
        for (k, error) in hold::errors(&self.model, now, targets).iter().enumerate() {
            twist.fixed_rows_mut::<6>(6 * (k + 1)).copy_from(&(error * -gains.pose_gain));
        }
        let command = secondary + distribute(&(twist - product(&jacobian, &secondary, size)));

        let mut acceleration = distribute(&rate);
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
        tasks: (&Vector6<f64>, &[Pose<f64>]),
    ) -> Velocities {
        const { assert!(hold::MAX_HELD == 3) };
        let acceleration = match equations.held.len() {
            0 => self.acceleration::<6>(gains, now, equations, tasks),
            1 => self.acceleration::<12>(gains, now, equations, tasks),
            2 => self.acceleration::<18>(gains, now, equations, tasks),
            _ => self.acceleration::<24>(gains, now, equations, tasks),
        };
        acceleration.map_or_else(Velocities::zeros, |acceleration| equations.force(&acceleration) + equations.bias)
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
        let (held, memory) = memory.split_at_mut(hold::memory(self.model.held.len()).iter().sum());
        let mut sum = Vector6::zeros();
        integral.iter().zip(sum.iter_mut()).for_each(|(z, sum)| *sum = *z * self.gains[0].integral_gain);
        let estimates = self.bank.as_ref().map(|bank| (bank, bank.estimate(&self.model, &now, memory)));
        let effort = match &estimates {
            Some((bank, estimates)) => {
                let (estimate, equations) = estimates.likeliest();
                let present = &estimate.now;
                now.error = present.error;
                sum -= displacement(self.gains[0].compliance, equations, &estimate.disturbance, n);
                let targets = hold::targets(&self.model, present, self.period, held);
                let tasks = (&sum, &targets[..]);
                bank.mean(estimates, |k, now, equations| self.effort(&self.gains[k], now, equations, tasks))
            }
            None => {
                let targets = hold::targets(&self.model, &now, self.period, held);
                self.effort(&self.gains[0], &now, &self.model.equations(now.chain(), 0.0), (&sum, &targets))
            }
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

/// End effectors to hold, by their names.
fn held(scene: &Scene, names: &[String]) -> Result<Vec<EndEffector>, ControlError> {
    let in_use = scene.arm.as_ref().map_or(DEFAULT_END_EFFECTOR, |arm| arm.end_effector_name());
    let others: Vec<_> = scene.end_effector_names().into_iter().filter(|name| name != in_use).collect();
    let known = |name: &&String| others.contains(name) && names.iter().filter(|other| other == name).count() == 1;
    if names.len() > hold::MAX_HELD || names.iter().filter(known).count() < names.len() {
        let expected = match others.is_empty() {
            true => "empty: the scene has no other end effector".to_owned(),
            false => format!("different ones of {others:?}, at most {}", hold::MAX_HELD),
        };
        return Err(ControlError::GainShape { name: "hold".into(), value: format!("{names:?}"), expected });
    }
    let chosen = |name: &String| scene.with_end_effector(name).ok().map(|scene| EndEffector::new(&scene));
    Ok(names.iter().filter_map(chosen).collect())
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
        let memory = self.integrals()
            + hold::memory(self.model.held.len()).iter().sum::<usize>()
            + self.bank.as_ref().map_or(0, MotionBank::memory);
        Widths { observation: self.indices.width, memory, action: self.actions.len() }
    }

    fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        let integral = (self.integrals() > 0).then_some(("integral", 6));
        let hold = ["reference", "targets"].into_iter().zip(hold::memory(self.model.held.len()));
        let hold = hold.filter(|(_, length)| *length > 0);
        integral.into_iter().chain(hold).chain(self.bank.iter().flat_map(MotionBank::memory_layout)).collect()
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().each_row(observations, memory, actions, |observation, memory, action| {
            self.control(observation, memory, action);
        })
    }
}

//! End-effector tracking by resolved motion, from observations alone.

mod observer;
#[cfg(test)]
mod tests;

use nalgebra::{SMatrix, Vector3, Vector6};

use self::observer::Model;
use super::controller::{Controller, Widths};
use super::{ACTIONS, ActionMap, Actuation};
use crate::description::{JointLimits, Scene};
use crate::dynamics::{EquationsOfMotion, PassiveTorque, SerialChain, VELOCITIES, Velocities};
use crate::error::ControlError;
use crate::system::{JOINTS, Joints};

/// Gains of [`ResolvedMotion`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResolvedGains {
    /// Of the pose error on the end effector's commanded twist, 1/s.
    pub error: f64,
    /// Of the error of the vehicle's twist on its acceleration, 1/s.
    pub vehicle: f64,
    /// Of the error of the joints' rates on their accelerations, 1/s.
    pub joint: f64,
    /// Of the distance of the joints from home on their rates, as far as the end effector does not feel it, 1/s.
    pub home: f64,
    /// Likewise of the vehicle's tilt, 1/s.
    pub level: f64,
    /// How readily joints move against the vehicle: an arm of length 1 m takes as much of a motion at 1.
    pub arm: f64,
    /// Share of the thrusters' nominal lag over a period that is made up for; only where a model runs along.
    pub lead: f64,
    /// Of the integral of the pose error, over `error`, 1/s; 0 for none.
    pub integral: f64,
    /// Bandwidths of the disturbance observer: of forces and moments on the vehicle, and of torques on joints, rad/s; 0
    /// for none.
    pub observer: [f64; 3],
    /// Age of what is measured that a prediction makes up for, in control periods.
    pub delay: u32,
}

/// Most control periods that are predicted.
pub const MOST_DELAY: u32 = 10;

impl Default for ResolvedGains {
    fn default() -> Self {
        Self {
            error: 2.5,
            vehicle: 6.0,
            joint: 10.0,
            home: 0.5,
            level: 0.5,
            arm: 2.0,
            lead: 0.0,
            integral: 0.0,
            observer: [0.0; 3],
            delay: 0,
        }
    }
}

impl ResolvedGains {
    fn check(&self) -> Result<(), ControlError> {
        let Self { error, vehicle, joint, home, level, arm, lead, integral, observer, delay } = *self;
        let named = [
            ("error", error),
            ("vehicle", vehicle),
            ("joint", joint),
            ("home", home),
            ("level", level),
            ("arm", arm),
            ("lead", lead),
            ("integral", integral),
        ];
        let all = named.into_iter().map(|(name, value)| (name, 0, value));
        let mut all = all.chain(observer.into_iter().enumerate().map(|(index, value)| ("observer", index, value)));
        if let Some((name, index, value)) = all.find(|(_, _, k)| !(k.is_finite() && *k >= 0.0)) {
            return Err(ControlError::Gain { name, index, value });
        }
        if delay > MOST_DELAY {
            return Err(ControlError::Delay { periods: delay, most: MOST_DELAY });
        }
        Ok(())
    }

    /// Whether a model runs along.
    fn foresees(&self) -> bool {
        self.delay > 0 || self.observer.iter().any(|bandwidth| *bandwidth > 0.0)
    }
}

/// Share of its travel within which a joint that nears a limit is spared.
const MARGIN: f64 = 0.15;
/// Damping of the pseudo-inverse, as a share of the vehicle's own weight.
const DAMPING: f64 = 1e-3;
/// An actuator falls short where it misses more than this share of its limit: actions are rounded to f32.
const MISSED: f64 = 1e-4;

/// A run of entries of an observation: the first, and the scales that undo the normalisation.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BlockIndices {
    /// First entry.
    pub offset: usize,
    /// Physical value of 1, per entry.
    pub scale: Vec<f64>,
}

impl BlockIndices {
    /// Physical values at one row of observations.
    pub fn read<'a>(&'a self, observation: &'a [f32]) -> impl Iterator<Item = f64> + 'a {
        self.scale.iter().zip(&observation[self.offset..]).map(|(scale, x)| f64::from(*x) * scale)
    }
}

/// Where [`ResolvedMotion`] finds what it reads.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackingIndices {
    /// Length of a row.
    pub width: usize,
    /// Both pose errors of the end effector, 6.
    pub error: BlockIndices,
    /// Body twist of the vehicle, 6.
    pub twist: BlockIndices,
    /// Direction against gravity, body axes, 3.
    pub up: BlockIndices,
    /// Joint coordinates relative to home, n.
    pub q: BlockIndices,
    /// Joint rates, n.
    pub qd: BlockIndices,
    /// Twist of the reference, end-effector axes, 6.
    pub reference: BlockIndices,
    /// Errors against the first point ahead, 6, and the time to it, s.
    pub ahead: Option<(BlockIndices, f64)>,
}

/// Resolved motion and inverse dynamics. `[Whi69]`
///
/// The end effector's commanded twist is the reference's less `error` times the pose error and its integral. A damped and
/// weighted pseudo-inverse of its Jacobian shares it out among vehicle and joints; what the end effector does not feel of
/// it pulls the arm home and the vehicle level. Inverse dynamics (`[HC eq. 13]`, in still water) turns the error of these
/// velocities and the reference's acceleration into a wrench and torques, clipped to what the actuators can do.
///
/// With `observer` the forces that the model does not know of are estimated from how the velocities went, and made up
/// for; with `delay` all of it acts on a prediction of the present from what was measured so many periods ago.
pub struct ResolvedMotion {
    reading: TrackingIndices,
    gains: ResolvedGains,
    actions: ActionMap,
    actuation: Actuation<f64>,
    chain: SerialChain,
    model: Option<Model>,
    /// Control period, s.
    period: f64,
    home: Vec<f64>,
    limits: Vec<Option<JointLimits>>,
    /// 1 for the axes of the vehicle that its thrusters can move, else 0.
    actuated: [f64; 6],
}

/// What a controller knows of the present.
#[derive(Debug, Clone, PartialEq)]
struct Present {
    /// Both pose errors of the end effector.
    error: Vector6<f64>,
    velocities: Velocities,
    /// Direction against gravity, vehicle axes, as measured: of length 1 but for noise.
    up: Vector3<f64>,
    q: Joints,
    /// Twist of the reference, end-effector axes.
    reference: Vector6<f64>,
    /// What it changes by, m/s^2; of turning nothing is known.
    acceleration: Vector6<f64>,
}

impl ResolvedMotion {
    /// For a checked scene, to act every `period` s.
    ///
    /// # Errors
    /// `ControlError` for a gain that is not finite or is negative, a delay beyond [`MOST_DELAY`], or a scene that does
    /// not compose.
    pub fn new(
        scene: &Scene,
        reading: TrackingIndices,
        gains: ResolvedGains,
        actions: ActionMap,
        period: f64,
    ) -> Result<Self, ControlError> {
        gains.check()?;
        let chain = SerialChain::new(scene).map_err(|error| ControlError::Model(error.to_string()))?;
        let actuated = actions.allocation().wrench_limits().map(|limit| f64::from(u8::from(limit > 0.0)));
        let (home, limits) = scene.joints().map(|joint| (joint.home, joint.limits.clone())).unzip();
        let model = gains.foresees().then(|| Model::new(&gains, scene, &actions, period));
        let actuation = Actuation::new(&actions);
        Ok(Self { reading, gains, actions, actuation, chain, model, period, home, limits, actuated })
    }

    /// Gains in use.
    pub fn gains(&self) -> &ResolvedGains {
        &self.gains
    }

    fn read(&self, observation: &[f32]) -> Present {
        let reading = &self.reading;
        let six = |entries: &BlockIndices| Vector6::from_iterator(entries.read(observation));
        let mut velocities = Velocities::zeros();
        let rates = reading.twist.read(observation).chain(reading.qd.read(observation));
        rates.zip(velocities.iter_mut()).for_each(|(x, velocity)| *velocity = x);
        let mut q = [0.0; JOINTS];
        for (k, x) in reading.q.read(observation).enumerate() {
            q[k] = x + self.home[k];
        }
        let up = Vector3::from_iterator(reading.up.read(observation));
        let (error, reference) = (six(&reading.error), six(&reading.reference));
        // The reference's velocity changes by this on the way to the first point ahead.
        let acceleration = reading.ahead.as_ref().map_or_else(Vector6::zeros, |(ahead, time)| {
            let moved = error - six(ahead);
            let mut acceleration = (moved - reference * *time) * (2.0 / (time * time));
            acceleration.fixed_rows_mut::<3>(3).fill(0.0);
            acceleration
        });
        Present { error, velocities, up, q, reference, acceleration }
    }

    /// The equations of motion, and what joints make by themselves.
    fn terms(&self, now: &Present) -> (EquationsOfMotion, [PassiveTorque; JOINTS]) {
        let mut passive = [PassiveTorque::default(); JOINTS];
        for (k, passive) in passive.iter_mut().enumerate().take(self.home.len()) {
            *passive = self.chain.passive(k, now.q[k], now.velocities[6 + k]);
        }
        let up = now.up.try_normalize(0.0).unwrap_or_else(Vector3::z);
        (self.chain.at(&up, &now.q, &now.velocities), passive)
    }

    /// Accelerations that are wanted now, for an integral of the pose error.
    fn acceleration(&self, now: &Present, terms: &EquationsOfMotion, integral: &Vector6<f64>) -> Option<Velocities> {
        let (gains, n, q) = (&self.gains, self.home.len(), &now.q);
        let jacobian = &terms.jacobian;
        // Mobilities: one over the weights.
        let mut mobility = Velocities::zeros();
        for k in 0..6 {
            mobility[k] = self.actuated[k];
        }
        for k in 0..n {
            let spared = self.limits[k].as_ref().map_or(1.0, |limits| {
                let room = (q[k] - limits.lower).min(limits.upper - q[k]);
                (room / (MARGIN * (limits.upper - limits.lower))).clamp(0.0, 1.0)
            });
            mobility[6 + k] = gains.arm * spared;
        }
        let mut scaled = jacobian.transpose();
        for k in 0..VELOCITIES {
            scaled.row_mut(k).scale_mut(mobility[k]);
        }
        let damped = jacobian * scaled + SMatrix::<f64, 6, 6>::identity() * DAMPING;
        // It is symmetric and positive: there is a factor.
        let factor = damped.cholesky()?;
        let share_out = |motion: &Vector6<f64>| scaled * factor.solve(motion);

        let mut leisure = Velocities::zeros();
        // The rotation that takes the vehicle's z axis upright.
        leisure.fixed_rows_mut::<3>(3).copy_from(&(Vector3::z().cross(&now.up) * gains.level));
        for k in 0..n {
            leisure[6 + k] = gains.home * (self.home[k] - q[k]);
        }
        let error = now.error + integral * gains.integral;
        let wanted = leisure + share_out(&(now.reference - error * gains.error - jacobian * leisure));

        let mut acceleration = share_out(&now.acceleration);
        for k in 0..6 + n {
            let gain = if k < 6 { gains.vehicle } else { gains.joint };
            acceleration[k] += gain * (wanted[k] - now.velocities[k]);
        }
        Some(acceleration)
    }

    /// One action, and the memory that follows.
    fn control(&self, observation: &[f32], memory: &mut [f64], action: &mut [f32]) {
        let n = self.home.len();
        let mut now = self.read(observation);
        let (integral, memory) = memory.split_at_mut(if self.gains.integral > 0.0 { 6 } else { 0 });
        let estimate = self.model.as_ref().map(|model| (model, model.estimate(self, &mut now, memory)));
        let own;
        let (terms, passive) = match &estimate {
            Some((_, estimate)) => (&estimate.terms, &estimate.passive),
            None => {
                own = self.terms(&now);
                (&own.0, &own.1)
            }
        };
        let mut sum = Vector6::zeros();
        integral.iter().zip(sum.iter_mut()).for_each(|(z, sum)| *sum = *z);
        let mut effort = Velocities::zeros();
        if let Some(acceleration) = self.acceleration(&now, terms, &sum) {
            effort = terms.mass * acceleration + terms.bias;
            for k in 0..n {
                effort[6 + k] -= passive[k].torque;
                if estimate.is_some() {
                    // As it will be at the period's end: light joints come to rest well within one.
                    effort[6 + k] += self.period * self.falls(&passive[k]) * acceleration[6 + k];
                }
            }
        }
        if let Some((model, estimate)) = &estimate {
            effort -= estimate.disturbance;
            model.lead(estimate, &mut effort);
        }
        self.actions.normalise_all(&effort.fixed_rows::<6>(0).into_owned(), &effort.as_slice()[6..6 + n], action);
        if self.widths().memory == 0 {
            return;
        }
        let reached = self.reached(action);
        if !integral.is_empty() {
            let limits = self.actions.allocation().wrench_limits();
            let short = |k: usize, limit: f64| limit > 0.0 && (effort[k] - reached[k]).abs() > MISSED * limit;
            let saturated = (0..6).any(|k| short(k, limits[k]))
                || self.actions.torques().iter().enumerate().any(|(k, limit)| short(6 + k, *limit));
            for (z, error) in integral.iter_mut().zip(&now.error) {
                if !(saturated && *z * error > 0.0) {
                    *z += self.period * error;
                }
            }
        }
        if let Some((model, estimate)) = &estimate {
            model.remember(self, &now, &reached, estimate, memory);
        }
    }

    /// By how much a joint's own torque falls with its rate over a period.
    fn falls(&self, passive: &PassiveTorque) -> f64 {
        passive.damping + self.period * passive.stiffness
    }

    /// Wrench and torques that an action asks for, within what actuators can do.
    fn reached(&self, action: &[f32]) -> Velocities {
        let mut entries = [0.0; ACTIONS];
        entries.iter_mut().zip(action).for_each(|(entry, a)| *entry = f64::from(*a));
        let actuated = self.actuation.act(&entries);
        let mut reached = Velocities::zeros();
        reached.fixed_rows_mut::<6>(0).copy_from_slice(&actuated.wrench.to_array());
        reached.fixed_rows_mut::<JOINTS>(6).copy_from_slice(&actuated.torques);
        reached
    }
}

impl Controller for ResolvedMotion {
    fn widths(&self) -> Widths {
        let integral = if self.gains.integral > 0.0 { 6 } else { 0 };
        let memory = integral + self.model.as_ref().map_or(0, Model::memory);
        Widths { observation: self.reading.width, memory, action: self.actions.len() }
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        let widths = self.widths();
        widths.rows(observations, memory, actions)?;
        let rows = observations.chunks_exact(widths.observation).zip(actions.chunks_exact_mut(widths.action.max(1)));
        for (k, (observation, action)) in rows.enumerate() {
            self.control(observation, &mut memory[k * widths.memory..][..widths.memory], action);
        }
        Ok(())
    }
}

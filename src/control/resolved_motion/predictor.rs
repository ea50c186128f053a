//! Disturbance observer of resolved motion, and prediction over control periods.

use nalgebra::Vector6;

use super::gains::ResolvedMotionGains;
use super::reading::TrackingState;
use crate::control::ActionMap;
use crate::control::equations::{Equations, VELOCITIES, Velocities};
use crate::control::nominal_model::{NominalModel, lag_decay};
use crate::system::JOINTS;

/// Bound on predicted velocities, m/s and rad/s.
const FASTEST: f64 = 20.0;

/// Prediction once per control period T, implicit in the friction of joints, as their motions are fast against it,
///
/// ```text
/// nu- = nu + T (M + T D)^-1 (u - h + d)        nu := nu- + l1 (nu_m - nu-)        d := d + l2 (M + T D) (nu_m - nu-) / T
/// ```
///
/// where u is the commanded effort within the actuators' limits, behind the thrusters' nominal lag, h the bias force of
/// the nominal system in still water, d the disturbing generalized force, and nu_m the measured velocity.
/// Both poles of the observer are `exp(-w T)` at a bandwidth w: `l1 = 1 - p^2`, `l2 = (1 - p)^2`.
pub(in crate::control) struct Predictor {
    /// l1 and l2 of each velocity.
    corrections: [[f64; 2]; VELOCITIES],
    /// Bounds on disturbances.
    maximum: Velocities,
    /// Decay of the gap between wrench and command over a period: at its end, and on average.
    pub lag: [f64; 2],
    lag_compensation: f64,
    /// Control period, s.
    pub period: f64,
    /// Velocities of vehicle and joints.
    pub size: usize,
}

impl Predictor {
    pub fn new(gains: &ResolvedMotionGains, model: &NominalModel, actions: &ActionMap, period: f64) -> Self {
        let corrections = std::array::from_fn(|k| {
            let bandwidth = gains.observer_bandwidth[(k / 3).min(2)];
            let pole = (-bandwidth * period).exp();
            if bandwidth > 0.0 { [1.0 - pole * pole, (1.0 - pole) * (1.0 - pole)] } else { [1.0, 0.0] }
        });
        let limits = actions.allocation().wrench_limits();
        let most = |three: &[f64]| three.iter().copied().fold(0.0, f64::max);
        let maximum = Velocities::from_fn(|k, _| match k {
            0..3 => most(&limits[..3]),
            3..6 => most(&limits[3..]),
            _ => actions.torques().get(k - 6).copied().unwrap_or(0.0),
        });
        Self {
            corrections,
            maximum,
            lag: lag_decay(period, model.lag()).into(),
            lag_compensation: gains.lag_compensation,
            period,
            size: 6 + actions.torques().len(),
        }
    }

    /// Velocities by their prediction and the innovation.
    pub fn correct(&self, predicted: &[f64], innovation: &Velocities, velocities: &mut Velocities) {
        for (k, predicted) in predicted.iter().enumerate() {
            velocities[k] = predicted + self.corrections[k][0] * innovation[k];
        }
    }

    /// Equations of motion at a state, implicit over a period.
    pub fn equations(&self, model: &NominalModel, now: &TrackingState) -> Equations {
        model.equations(now.chain(), self.period)
    }

    /// Disturbance by the innovation's effect, `(M + T D) (nu_m - nu-)`.
    pub fn disturb(&self, effect: &Velocities, disturbance: &mut [f64]) {
        for (k, disturbance) in disturbance.iter_mut().enumerate() {
            let limit = self.maximum[k];
            *disturbance = (*disturbance + self.corrections[k][1] * effect[k] / self.period).clamp(-limit, limit);
        }
    }

    /// Prediction over a period under an effort and a disturbance; its middle is `before` periods before the present.
    pub fn advance(
        &self,
        equations: &Equations,
        (now, wrench): (&mut TrackingState, &mut Vector6<f64>),
        [effort, disturbance]: [&Velocities; 2],
        before: f64,
    ) {
        let period = self.period;
        let mut net = effort + disturbance - equations.bias;
        for k in 0..6 {
            net[k] += (wrench[k] - effort[k]) * self.lag[1];
            wrench[k] = effort[k] + (wrench[k] - effort[k]) * self.lag[0];
        }
        let change = equations.solve(&net) * period;
        let mean = now.velocities + change * 0.5;
        now.velocities = (now.velocities + change).map(|x| x.clamp(-FASTEST, FASTEST));
        now.error += (equations.twist(&mean) - (now.reference - now.acceleration * (before * period))) * period;
        for k in 0..JOINTS {
            now.q[k] += mean[6 + k] * period;
        }
        let omega = mean.fixed_rows::<3>(3).into_owned();
        now.up += now.up.cross(&omega) * period;
    }

    /// Adds a share of the thrusters' mean lag over the period to the command.
    pub fn compensate_lag(&self, wrench: &Vector6<f64>, effort: &mut Velocities) {
        let ahead = self.lag_compensation * self.lag[1] / (1.0 - self.lag[1]);
        for k in 0..6 {
            effort[k] += ahead * (effort[k] - wrench[k]);
        }
    }
}

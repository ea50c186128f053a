//! Disturbance observer of resolved motion, and prediction of the present from delayed measurements.

use nalgebra::{Cholesky, Const, Vector6};

use super::gains::ResolvedMotionGains;
use super::model::{NominalModel, TrackingState};
use crate::control::ActionMap;
use crate::description::Scene;
use crate::dynamics::{EquationsOfMotion, MassMatrix, PassiveTorque, VELOCITIES, Velocities};
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
pub(super) struct Predictor {
    joints: usize,
    /// Age of measurements, control periods.
    delay: usize,
    /// l1 and l2 of each velocity.
    corrections: [[f64; 2]; VELOCITIES],
    /// Bounds on disturbances.
    greatest: Velocities,
    /// Decay of the gap between wrench and command over a period: at its end, and on average.
    lag: [f64; 2],
    lag_compensation: f64,
}

/// Estimate of the present.
pub(super) struct Estimate {
    /// d.
    pub disturbance: Velocities,
    /// Wrench of the thrusters now.
    wrench: Vector6<f64>,
    /// nu- and the wrench at the next measurement, where they are predicted already.
    next: Option<(Velocities, Vector6<f64>)>,
    /// Present equations of motion.
    pub terms: EquationsOfMotion,
    /// Present passive torques of the joints.
    pub passive: [PassiveTorque; JOINTS],
    /// True if the next measurement is of a later time than this one.
    moves: bool,
}

impl Predictor {
    pub fn new(gains: &ResolvedMotionGains, scene: &Scene, actions: &ActionMap, period: f64) -> Self {
        let joints = actions.torques().len();
        let corrections = std::array::from_fn(|k| {
            let bandwidth = gains.observer_bandwidth[(k / 3).min(2)];
            let pole = (-bandwidth * period).exp();
            if bandwidth > 0.0 { [1.0 - pole * pole, (1.0 - pole) * (1.0 - pole)] } else { [1.0, 0.0] }
        });
        let limits = actions.allocation().wrench_limits();
        let most = |three: &[f64]| three.iter().copied().fold(0.0, f64::max);
        let greatest = Velocities::from_fn(|k, _| match k {
            0..3 => most(&limits[..3]),
            3..6 => most(&limits[3..]),
            _ => actions.torques().get(k - 6).copied().unwrap_or(0.0),
        });
        let thrusters = scene.vehicle.thrusters.len();
        let mean = (0..thrusters).map(|i| scene.vehicle.lag(i)).sum::<f64>() / thrusters.max(1) as f64;
        let end = if mean > 0.0 { (-period / mean).exp() } else { 0.0 };
        let lag = [end, mean / period * (1.0 - end)];
        Self { joints, delay: gains.delay, corrections, greatest, lag, lag_compensation: gains.lag_compensation }
    }

    fn size(&self) -> usize {
        6 + self.joints
    }

    /// Numbers of memory: periods so far, nu-, d, the wrench of the thrusters, and commanded efforts, the latest first.
    pub fn memory(&self) -> usize {
        1 + (2 + self.delay) * self.size() + 6
    }

    pub fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        let n = self.size();
        vec![("periods", 1), ("velocity", n), ("disturbance", n), ("thrust", 6), ("efforts", self.delay * n)]
    }

    /// Updates the estimate by a measurement, and predicts `now` from its instant to the present.
    pub fn estimate(&self, model: &NominalModel, now: &mut TrackingState, memory: &mut [f64]) -> Estimate {
        let size = self.size();
        let (count, memory) = memory.split_at_mut(1);
        let (predicted, memory) = memory.split_at_mut(size);
        let (remembered, memory) = memory.split_at_mut(size);
        let (wrench, efforts) = memory.split_at_mut(6);
        let periods = count[0] as usize;
        let mut disturbance = padded(remembered);
        let mut known = None;
        if periods > self.delay {
            let innovation = now.velocities - padded(predicted);
            for k in 0..size {
                now.velocities[k] = predicted[k] + self.corrections[k][0] * innovation[k];
            }
            let (terms, passive) = model.terms(now);
            let effect = self.inertia(model, &terms, &passive) * innovation / model.period;
            for k in 0..size {
                let limit = self.greatest[k];
                disturbance[k] = (disturbance[k] + self.corrections[k][1] * effect[k]).clamp(-limit, limit);
            }
            remembered.copy_from_slice(&disturbance.as_slice()[..size]);
            known = Some((terms, passive));
        }
        let mut wrench = Vector6::from_column_slice(wrench);
        let mut next = None;
        let past = periods.min(self.delay);
        for step in (0..past).rev() {
            let (terms, passive) = known.take().unwrap_or_else(|| model.terms(now));
            let effort = padded(&efforts[step * size..][..size]);
            self.advance(model, now, &terms, &passive, &effort, &mut wrench, &disturbance, step as f64 + 0.5);
            if step + 1 == past {
                next = Some((now.velocities, wrench));
            }
        }
        let (terms, passive) = known.unwrap_or_else(|| model.terms(now));
        Estimate { disturbance, wrench, next, moves: periods >= self.delay, terms, passive }
    }

    /// `M + T D`.
    fn inertia(
        &self,
        model: &NominalModel,
        terms: &EquationsOfMotion,
        passive: &[PassiveTorque; JOINTS],
    ) -> MassMatrix {
        let mut inertia = terms.mass;
        for k in 0..self.joints {
            inertia[(6 + k, 6 + k)] += model.period * model.joint_damping(&passive[k]);
        }
        inertia
    }

    /// Prediction over a period under an effort; its middle is `before` periods before the present.
    #[expect(clippy::too_many_arguments, reason = "all of the model's state")]
    fn advance(
        &self,
        model: &NominalModel,
        now: &mut TrackingState,
        terms: &EquationsOfMotion,
        passive: &[PassiveTorque; JOINTS],
        effort: &Velocities,
        wrench: &mut Vector6<f64>,
        disturbance: &Velocities,
        before: f64,
    ) {
        let period = model.period;
        let mut net = effort + disturbance - terms.bias;
        for k in 0..6 {
            net[k] += (wrench[k] - effort[k]) * self.lag[1];
            wrench[k] = effort[k] + (wrench[k] - effort[k]) * self.lag[0];
        }
        for k in 0..self.joints {
            net[6 + k] += passive[k].torque;
        }
        // Without a factor, which does not happen, velocities stay.
        let factor: Option<Cholesky<f64, Const<VELOCITIES>>> = self.inertia(model, terms, passive).cholesky();
        let change = factor.map_or_else(Velocities::zeros, |factor| factor.solve(&net) * period);
        let mean = now.velocities + change * 0.5;
        now.velocities = (now.velocities + change).map(|x| x.clamp(-FASTEST, FASTEST));
        now.error += (terms.jacobian * mean - (now.reference - now.acceleration * (before * period))) * period;
        for k in 0..self.joints {
            now.q[k] += mean[6 + k] * period;
        }
        let omega = mean.fixed_rows::<3>(3).into_owned();
        now.up += now.up.cross(&omega) * period;
    }

    /// Adds a share of the thrusters' mean lag over the period to the command.
    pub fn compensate_lag(&self, estimate: &Estimate, effort: &mut Velocities) {
        let ahead = self.lag_compensation * self.lag[1] / (1.0 - self.lag[1]);
        for k in 0..6 {
            effort[k] += ahead * (effort[k] - estimate.wrench[k]);
        }
    }

    /// Stores the commanded effort, and the prediction of the next measurement.
    pub fn remember(
        &self,
        model: &NominalModel,
        now: &TrackingState,
        effort: &Velocities,
        estimate: &Estimate,
        memory: &mut [f64],
    ) {
        let size = self.size();
        let (predicted, wrench) = estimate.next.unwrap_or_else(|| {
            let (mut later, mut wrench) = (now.clone(), estimate.wrench);
            self.advance(
                model,
                &mut later,
                &estimate.terms,
                &estimate.passive,
                effort,
                &mut wrench,
                &estimate.disturbance,
                0.0,
            );
            (later.velocities, wrench)
        });
        memory[0] = (memory[0] + 1.0).min((self.delay + 1) as f64);
        memory[1..][..size].copy_from_slice(&predicted.as_slice()[..size]);
        if estimate.moves {
            memory[1 + 2 * size..][..6].copy_from_slice(wrench.as_slice());
        }
        let efforts = &mut memory[1 + 2 * size + 6..];
        if self.delay > 0 {
            efforts.copy_within(..(self.delay - 1) * size, size);
            efforts[..size].copy_from_slice(&effort.as_slice()[..size]);
        }
    }
}

/// Velocities or forces, padded with 0.
fn padded(given: &[f64]) -> Velocities {
    let mut all = Velocities::zeros();
    all.iter_mut().zip(given).for_each(|(entry, x)| *entry = *x);
    all
}

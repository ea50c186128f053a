//! What runs along with resolved motion: a disturbance observer, and a prediction of the present from late measurements.

use nalgebra::{Cholesky, Const, Vector6};

use super::{Present, ResolvedGains, ResolvedMotion};
use crate::control::ActionMap;
use crate::description::Scene;
use crate::dynamics::{EquationsOfMotion, MassMatrix, PassiveTorque, VELOCITIES, Velocities};
use crate::system::JOINTS;

/// Velocities are within this, m/s and rad/s, as far as the model is concerned.
const FASTEST: f64 = 20.0;

/// The model that runs along, once per control period: over a period T and with the friction of joints taken at its end,
/// as their motions are fast against it,
///
/// ```text
/// nu- = nu + T (M + T D)^-1 (u - h + d)        nu := nu- + l1 (nu_m - nu-)        d := d + l2 (M + T D) (nu_m - nu-) / T
/// ```
///
/// where u is what was asked for within the actuators' limits, behind the thrusters' nominal lag, h what the nominal
/// system takes in still water, d the generalized force that it does not account for, and nu_m the measured velocity.
/// Both poles of the observer are `exp(-w T)` at a bandwidth w: `l1 = 1 - p^2`, `l2 = (1 - p)^2`.
pub(super) struct Model {
    joints: usize,
    /// Control periods that measurements are late by.
    delay: usize,
    /// l1 and l2 of each velocity.
    corrections: [[f64; 2]; VELOCITIES],
    /// Greatest forces that are taken for disturbances.
    greatest: Velocities,
    /// Shares of the wrench at a period's start that are left of it at its end, and on average over it.
    lag: [f64; 2],
    lead: f64,
}

/// What the model makes of the present.
pub(super) struct Estimate {
    /// d.
    pub disturbance: Velocities,
    /// Wrench of the thrusters now.
    wrench: Vector6<f64>,
    /// nu- at the next measurement, and the wrench then, where they are known already.
    next: Option<(Velocities, Vector6<f64>)>,
    /// The equations of motion now.
    pub terms: EquationsOfMotion,
    /// What joints make by themselves now.
    pub passive: [PassiveTorque; JOINTS],
    /// Whether the next measurement is of a later time than this one.
    moves: bool,
}

impl Model {
    pub fn new(gains: &ResolvedGains, scene: &Scene, actions: &ActionMap, period: f64) -> Self {
        let joints = actions.torques().len();
        let corrections = std::array::from_fn(|k| {
            let bandwidth = gains.observer[(k / 3).min(2)];
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
        let left = if mean > 0.0 { (-period / mean).exp() } else { 0.0 };
        let lag = [left, mean / period * (1.0 - left)];
        Self { joints, delay: gains.delay as usize, corrections, greatest, lag, lead: gains.lead }
    }

    fn size(&self) -> usize {
        6 + self.joints
    }

    /// Numbers remembered: periods so far, nu-, d, the wrench of the thrusters, and efforts asked for, the latest first.
    pub fn memory(&self) -> usize {
        1 + (2 + self.delay) * self.size() + 6
    }

    /// Takes what is measured into account, and moves `now` from when that was to the present.
    pub fn estimate(&self, of: &ResolvedMotion, now: &mut Present, memory: &mut [f64]) -> Estimate {
        let size = self.size();
        let (count, memory) = memory.split_at_mut(1);
        let (foreseen, memory) = memory.split_at_mut(size);
        let (remembered, memory) = memory.split_at_mut(size);
        let (wrench, efforts) = memory.split_at_mut(6);
        let periods = count[0] as usize;
        let mut disturbance = taken(remembered);
        let mut known = None;
        if periods > self.delay {
            let miss = now.velocities - taken(foreseen);
            for k in 0..size {
                now.velocities[k] = foreseen[k] + self.corrections[k][0] * miss[k];
            }
            let (terms, passive) = of.terms(now);
            let effect = self.inertia(of, &terms, &passive) * miss / of.period;
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
            let (terms, passive) = known.take().unwrap_or_else(|| of.terms(now));
            let effort = taken(&efforts[step * size..][..size]);
            self.advance(of, now, &terms, &passive, &effort, &mut wrench, &disturbance, step as f64 + 0.5);
            if step + 1 == past {
                next = Some((now.velocities, wrench));
            }
        }
        let (terms, passive) = known.unwrap_or_else(|| of.terms(now));
        Estimate { disturbance, wrench, next, moves: periods >= self.delay, terms, passive }
    }

    /// `M + T D`.
    fn inertia(&self, of: &ResolvedMotion, terms: &EquationsOfMotion, passive: &[PassiveTorque; JOINTS]) -> MassMatrix {
        let mut inertia = terms.mass;
        for k in 0..self.joints {
            inertia[(6 + k, 6 + k)] += of.period * of.falls(&passive[k]);
        }
        inertia
    }

    /// A period passes under an effort, `before` periods before the present at its middle.
    #[expect(clippy::too_many_arguments, reason = "all of the model's state")]
    fn advance(
        &self,
        of: &ResolvedMotion,
        now: &mut Present,
        terms: &EquationsOfMotion,
        passive: &[PassiveTorque; JOINTS],
        effort: &Velocities,
        wrench: &mut Vector6<f64>,
        disturbance: &Velocities,
        before: f64,
    ) {
        let period = of.period;
        let mut net = effort + disturbance - terms.bias;
        for k in 0..6 {
            net[k] += (wrench[k] - effort[k]) * self.lag[1];
            wrench[k] = effort[k] + (wrench[k] - effort[k]) * self.lag[0];
        }
        for k in 0..self.joints {
            net[6 + k] += passive[k].torque;
        }
        // Without a factor, which does not happen, all stays as it is.
        let factor: Option<Cholesky<f64, Const<VELOCITIES>>> = self.inertia(of, terms, passive).cholesky();
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

    /// Asks for more, by a share, of what the thrusters lag behind on average over the period.
    pub fn lead(&self, estimate: &Estimate, effort: &mut Velocities) {
        let ahead = self.lead * self.lag[1] / (1.0 - self.lag[1]);
        for k in 0..6 {
            effort[k] += ahead * (effort[k] - estimate.wrench[k]);
        }
    }

    /// Remembers what was asked for, and what is to be measured next.
    pub fn remember(
        &self,
        of: &ResolvedMotion,
        now: &Present,
        effort: &Velocities,
        estimate: &Estimate,
        memory: &mut [f64],
    ) {
        let size = self.size();
        let (foreseen, wrench) = estimate.next.unwrap_or_else(|| {
            let (mut later, mut wrench) = (now.clone(), estimate.wrench);
            self.advance(
                of,
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
        memory[1..][..size].copy_from_slice(&foreseen.as_slice()[..size]);
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

/// The first velocities or forces, 0 past them.
fn taken(given: &[f64]) -> Velocities {
    let mut all = Velocities::zeros();
    all.iter_mut().zip(given).for_each(|(entry, x)| *entry = *x);
    all
}

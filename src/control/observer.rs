//! Disturbance observer on the vehicle's momentum, with compensation of delayed measurements.

use serde::{Deserialize, Serialize};

use super::kalman::{DisturbanceModel, ObserverGain, STATES, WaveTransition};
use super::nominal_model::{AppliedWrenches, ArmState, NominalModel, Prediction, VehicleMotion};
use super::rows::MeasuredMotion;
use crate::description::Scene;
use crate::dynamics::aba::Scratch;
use crate::lane::Lane;
use crate::lie::Vector6;
use crate::system::JOINTS;

/// Gains of the observer; pairs are linear and angular.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ObserverGains {
    /// Bandwidth of the slow disturbance, rad/s; 0: none.
    pub observer_bandwidth: [f64; 2],
    /// Standard deviation of wave accelerations, m/s2 and rad/s2.
    pub wave_acceleration: [f64; 2],
    /// Angular frequency of the waves, rad/s.
    pub wave_frequency: f64,
    /// White noise on accelerations, m/s2 and rad/s2 times the root of a second. Where this and `wave_acceleration` are
    /// 0 measurements count as exact; else a steady Kalman filter weighs them.
    pub acceleration_noise: [f64; 2],
    /// Age of measurements in control periods, which the model bridges.
    pub delay: usize,
}

/// Exact measurements without delay.
impl Default for ObserverGains {
    fn default() -> Self {
        Self {
            observer_bandwidth: [2.0; 2],
            wave_acceleration: [0.0; 2],
            wave_frequency: 1.0,
            acceleration_noise: [0.0; 2],
            delay: 0,
        }
    }
}

impl ObserverGains {
    /// A Kalman filter with a wave model, for measurements that are `delay` control periods old.
    pub fn filtering(delay: usize) -> Self {
        Self {
            observer_bandwidth: [8.0; 2],
            wave_acceleration: [0.3; 2],
            acceleration_noise: [0.05, 0.3],
            delay,
            ..Self::default()
        }
    }
}

/// Estimate of the present.
#[derive(Debug, Clone, Copy)]
pub struct ObserverEstimate<L> {
    /// Vehicle, after the prediction horizon.
    pub motion: VehicleMotion<L>,
    /// Arm, at the same time and a control period later.
    pub arms: [ArmState<L>; 2],
    /// Last command to the thrusters.
    pub command: Vector6<L>,
    /// Thrusters' present wrench.
    pub thrust: Vector6<L>,
    /// Disturbing wrench.
    pub disturbance: DisturbanceEstimate<L>,
    /// Measured twist minus the predicted one.
    pub innovation: Vector6<L>,
    /// Measured arm minus its reference for the instant of the measurement.
    pub arm_innovation: ArmState<L>,
}

/// Wrench that the model does not explain, at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DisturbanceEstimate<L> {
    /// Slow part.
    pub slow: Vector6<L>,
    /// Wave part, and its rate.
    pub wave: [Vector6<L>; 2],
}

impl WaveTransition {
    /// A wave and its rate after the time.
    #[inline(always)]
    pub(super) fn after<L: Lane<Real = f64>>(&self, [wave, rate]: [Vector6<L>; 2]) -> [Vector6<L>; 2] {
        let [[a, b], [c, d]] = self.0;
        [wave.scale_add(L::c(a), rate.scale(L::c(b))), wave.scale_add(L::c(c), rate.scale(L::c(d)))]
    }

    /// The disturbance after the time, and its mean over it.
    #[inline(always)]
    fn carry<L: Lane<Real = f64>>(&self, now: &DisturbanceEstimate<L>) -> (DisturbanceEstimate<L>, Vector6<L>) {
        let wave = self.after(now.wave);
        let mean = (now.wave[0] + wave[0]).scale_add(L::c(0.5), now.slow);
        (DisturbanceEstimate { slow: now.slow, wave }, mean)
    }
}

/// Observer of the vehicle's momentum.
///
/// From its last estimate it predicts the next measurement, with the commanded wrench through the thrusters' lag; the
/// innovation corrects the estimate, mostly the disturbance. Measurements are assumed to be `delay` control
/// periods old: from the estimate of that instant the model predicts the present, and beyond it by the horizon.
#[derive(Debug, Clone, PartialEq)]
pub struct Observer {
    model: NominalModel,
    /// Control period, s.
    period: f64,
    delay: usize,
    /// Time predicted beyond the present, s.
    horizon: f64,
    /// Per axis.
    gains: [ObserverGain; 6],
    wave: WaveTransition,
}

// Places in a row of memory.
const COUNT: usize = 0;
const STATE: usize = 1;
const ARM: usize = 37;

/// Pose error, twist, slow disturbance, thrusters' wrench, wave disturbance and its rate.
type ObserverState<L> = [Vector6<L>; 6];

#[inline(always)]
fn state_of<L: Lane>(
    VehicleMotion { error, twist }: VehicleMotion<L>,
    DisturbanceEstimate { slow, wave: [wave, rate] }: DisturbanceEstimate<L>,
    thrust: Vector6<L>,
) -> ObserverState<L> {
    [error, twist, slow, thrust, wave, rate]
}

impl Observer {
    /// For a checked scene that is measured and acted on every `period` s, by checked gains.
    pub fn new(by: ObserverGains, horizon: f64, scene: &Scene, period: f64) -> Self {
        let gains = [0, 1].map(|k| {
            let model = DisturbanceModel {
                bandwidth: by.observer_bandwidth[k],
                wave: by.wave_acceleration[k],
                noise: by.acceleration_noise[k],
            };
            if model.wave == 0.0 && model.noise == 0.0 {
                ObserverGain::momentum(model.bandwidth, period)
            } else {
                ObserverGain::kalman(&model, by.wave_frequency, period)
            }
        });
        Self {
            model: NominalModel::new(scene),
            period,
            delay: by.delay,
            horizon,
            gains: std::array::from_fn(|k| gains[k / 3]),
            wave: WaveTransition::over(by.wave_frequency, period),
        }
    }

    /// The nominal model.
    pub fn model(&self) -> &NominalModel {
        &self.model
    }

    /// Control period, s.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// Control periods since the episode began, up to one more than the delay.
    pub(super) fn periods<L: Lane>(&self, memory: &[L]) -> L {
        memory[COUNT]
    }

    /// Numbers of memory per instance.
    pub fn memory(&self) -> usize {
        self.references() + (self.delay + 1) * 2 * self.model.joints()
    }

    /// Names and lengths of the blocks of memory. The disturbance is the sum of its slow and its wave part.
    pub fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        let n = 2 * self.model.joints();
        vec![
            ("periods", 1),
            ("pose_error", 6),
            ("twist", 6),
            ("slow_disturbance", 6),
            ("thrust", 6),
            ("wave_disturbance", 6),
            ("wave_rate", 6),
            ("arm", n),
            ("commands", (self.delay + 1) * 6),
            ("arm_references", (self.delay + 1) * n),
        ]
    }

    /// Place of the commanded wrenches, the latest first.
    fn commands(&self) -> usize {
        ARM + 2 * self.model.joints()
    }

    /// Place of the arm's references, the present one first.
    fn references(&self) -> usize {
        self.commands() + (self.delay + 1) * 6
    }

    /// Updates the estimate by a measurement, and predicts the present.
    #[inline(always)]
    pub fn observe<L: Lane<Real = f64>>(
        &self,
        measured: &MeasuredMotion<L>,
        memory: &mut [L],
        scratch: &mut Scratch<L>,
    ) -> ObserverEstimate<L> {
        let n = self.model.joints();
        let count = memory[COUNT];
        // At an episode's first instant the memory is empty.
        let first = count.lt(L::c(0.5));
        for slot in 0..=self.delay {
            let place = self.references() + 2 * n * slot;
            let reference = ArmState::load(memory, place, n);
            ArmState::select(first, &measured.arm, &reference).store(memory, place, n);
        }

        // The measurement is of the instant `delay` ago, which may lie before the episode.
        let later = L::c(self.delay as f64).lt(count);
        let mut state: ObserverState<L> = [Vector6::zero(); 6];
        for part in 0..6 {
            state[part] = load(memory, STATE + 6 * part);
        }
        let (mut arm, mut next) = (ArmState::load(memory, ARM, n), measured.arm);
        // The arm moves as its reference does.
        let reference = ArmState::load(memory, self.references() + 2 * n * self.delay, n);
        let ahead = measured.reference.minus(&reference).scale_add(L::c(1.0), &measured.arm);

        // To the instant of the measurement, period by period to the present, and by the horizon beyond.
        let mut innovation = Vector6::zero();
        let legs = self.delay + 1 + usize::from(self.horizon > 0.0);
        for leg in 0..legs {
            let beyond = leg > self.delay;
            let age = self.delay.saturating_sub(leg);
            let [error, twist, slow, thrust, wave, rate] = state;
            let disturbance = DisturbanceEstimate { slow, wave: [wave, rate] };
            let (carried, mean) = if beyond {
                (disturbance, rate.scale_add(L::c(0.5 * self.horizon), wave) + slow)
            } else {
                self.wave.carry(&disturbance)
            };
            let wrenches =
                AppliedWrenches { command: load(memory, self.commands() + 6 * age), thrust, disturbance: mean };
            let time = if beyond { self.horizon } else { self.period };
            if leg > 0 {
                let then = ArmState::load(memory, self.references() + 2 * n * age, n);
                arm = next;
                next = if beyond {
                    ahead.minus(&arm).scale_add(L::c(self.horizon / self.period), &arm)
                } else {
                    then.minus(&reference).scale_add(L::c(1.0), &measured.arm)
                };
            }
            let from = VehicleMotion { error, twist };
            let predicted = self.model.predict(&from, [&arm, &next], &wrenches, time, scratch);
            if beyond {
                (state[0], state[1]) = (predicted.motion.error, predicted.motion.twist);
            } else if leg > 0 {
                let begun = L::c(age as f64 + 0.5).lt(count);
                state = select(begun, &state_of(predicted.motion, carried, predicted.thrust), &state);
            } else {
                innovation = measured.motion.twist - predicted.motion.twist;
                let (corrected, updated) = self.correct(measured, &predicted, &carried);
                let updated = state_of(corrected, updated, predicted.thrust);
                state = select(later, &updated, &state_of(measured.motion, disturbance, thrust));
                for part in 0..6 {
                    store(memory, STATE + 6 * part, state[part]);
                }
                measured.arm.store(memory, ARM, n);
            }
        }
        let arms =
            if self.horizon > 0.0 { [next, ahead.minus(&arm).scale_add(L::c(1.0), &next)] } else { [next, ahead] };
        let arm_innovation = measured.arm.minus(&reference);
        let [error, twist, slow, thrust, wave, rate] = state;
        let (motion, disturbance) = (VehicleMotion { error, twist }, DisturbanceEstimate { slow, wave: [wave, rate] });
        let command = load(memory, self.commands());
        ObserverEstimate { motion, arms, command, thrust, disturbance, innovation, arm_innovation }
    }

    /// Correction of a prediction by a measurement.
    #[inline(always)]
    fn correct<L: Lane<Real = f64>>(
        &self,
        measured: &MeasuredMotion<L>,
        predicted: &Prediction<L>,
        carried: &DisturbanceEstimate<L>,
    ) -> (VehicleMotion<L>, DisturbanceEstimate<L>) {
        let Prediction { motion, inertia, .. } = predicted;
        let pose = (measured.motion.error - motion.error).to_array();
        let twist = (measured.motion.twist - motion.twist).to_array();
        let mut parts = [[L::zero(); 6]; STATES];
        for k in 0..6 {
            for i in 0..STATES {
                let [by_pose, by_twist] = self.gains[k].0[i];
                parts[i][k] = L::c(by_twist).mul_add(twist[k], L::c(by_pose) * pose[k]);
            }
        }
        let motion = VehicleMotion {
            error: motion.error + Vector6::from_array(parts[0]),
            twist: motion.twist + Vector6::from_array(parts[1]),
        };
        let disturbance = DisturbanceEstimate {
            slow: carried.slow + inertia.apply(Vector6::from_array(parts[2])),
            wave: [
                carried.wave[0] + inertia.apply(Vector6::from_array(parts[3])),
                carried.wave[1] + inertia.apply(Vector6::from_array(parts[4])),
            ],
        };
        (motion, disturbance)
    }

    /// Stores the commanded wrench and the arm's reference.
    #[inline(always)]
    pub fn remember<L: Lane<Real = f64>>(&self, measured: &MeasuredMotion<L>, command: Vector6<L>, memory: &mut [L]) {
        let n = 2 * self.model.joints();
        let (commands, references) = (self.commands(), self.references());
        memory[commands..references].rotate_right(6);
        store(memory, commands, command);
        if n > 0 {
            memory[references..].rotate_right(n);
            measured.reference.store(memory, references, n / 2);
        }
        memory[COUNT] = (memory[COUNT] + L::c(1.0)).min(L::c(self.delay as f64 + 1.0));
    }
}

/// Six numbers from a place on.
#[inline(always)]
pub(super) fn load<L: Lane>(memory: &[L], place: usize) -> Vector6<L> {
    let mut all = [L::zero(); 6];
    all.copy_from_slice(&memory[place..place + 6]);
    Vector6::from_array(all)
}

#[inline(always)]
pub(super) fn store<L: Lane>(memory: &mut [L], place: usize, x: Vector6<L>) {
    memory[place..place + 6].copy_from_slice(&x.to_array());
}

/// `yes` where the mask is true, else `no`.
#[inline(always)]
fn select<L: Lane>(mask: L::Mask, yes: &ObserverState<L>, no: &ObserverState<L>) -> ObserverState<L> {
    let mut state = *no;
    for part in 0..6 {
        let (yes, mut all) = (yes[part].to_array(), no[part].to_array());
        for k in 0..6 {
            all[k] = L::select(mask, yes[k], all[k]);
        }
        state[part] = Vector6::from_array(all);
    }
    state
}

impl<L: Lane> ArmState<L> {
    #[inline(always)]
    fn load(memory: &[L], place: usize, n: usize) -> Self {
        let mut arm = Self { q: [L::zero(); JOINTS], qd: [L::zero(); JOINTS] };
        for i in 0..n {
            (arm.q[i], arm.qd[i]) = (memory[place + i], memory[place + n + i]);
        }
        arm
    }

    #[inline(always)]
    fn store(&self, memory: &mut [L], place: usize, n: usize) {
        for i in 0..n {
            (memory[place + i], memory[place + n + i]) = (self.q[i], self.qd[i]);
        }
    }
}

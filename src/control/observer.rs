//! Disturbance observer on the vehicle's momentum, with compensation of delayed measurements.

use serde::{Deserialize, Serialize};

use super::kalman::{DisturbanceModel, ObserverGain, STATES, WaveTransition};
use super::plant::{AppliedWrenches, ArmMotion, Plant, Prediction, VehicleMotion};
use super::rows::Measurement;
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
pub struct Estimate<L> {
    /// Vehicle, after the prediction horizon.
    pub motion: VehicleMotion<L>,
    /// Arm, at the same time and a control period later.
    pub arms: [ArmMotion<L>; 2],
    /// Last command to the thrusters.
    pub command: Vector6<L>,
    /// Thrusters' present wrench.
    pub thrust: Vector6<L>,
    /// Disturbing wrench.
    pub disturbance: Disturbance<L>,
    /// Measured twist less the predicted one.
    pub innovation: Vector6<L>,
    /// Measured arm less its reference for the instant of the measurement.
    pub arm_innovation: ArmMotion<L>,
}

/// Wrench that the model does not explain, at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disturbance<L> {
    /// Slow part.
    pub slow: Vector6<L>,
    /// Wave part, and its rate.
    pub wave: [Vector6<L>; 2],
}

impl<L: Lane> Disturbance<L> {
    /// This where the mask holds, else the other.
    #[inline(always)]
    fn or(&self, mask: L::Mask, other: &Self) -> Self {
        let [wave, rate] = self.wave;
        let wave = [or(mask, wave, other.wave[0]), or(mask, rate, other.wave[1])];
        Self { slow: or(mask, self.slow, other.slow), wave }
    }
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
    fn carry<L: Lane<Real = f64>>(&self, now: &Disturbance<L>) -> (Disturbance<L>, Vector6<L>) {
        let wave = self.after(now.wave);
        let mean = (now.wave[0] + wave[0]).scale_add(L::c(0.5), now.slow);
        (Disturbance { slow: now.slow, wave }, mean)
    }
}

/// Observer of the vehicle's momentum.
///
/// From its last estimate it predicts the next measurement, with the commanded wrench through the thrusters' lag; the
/// innovation corrects the estimate, above all that of the disturbance. Measurements are taken to be `delay` control
/// periods old: from the estimate of that instant the model predicts the present, and beyond it by the horizon.
#[derive(Debug, Clone, PartialEq)]
pub struct Observer {
    plant: Plant,
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
const MOTION: usize = 1;
const DISTURBANCE: usize = 13;
const THRUST: usize = 19;
const WAVE: usize = 25;
const ARM: usize = 37;

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
            plant: Plant::new(scene),
            period,
            delay: by.delay,
            horizon,
            gains: std::array::from_fn(|k| gains[k / 3]),
            wave: WaveTransition::over(by.wave_frequency, period),
        }
    }

    /// The nominal model.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Control period, s.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// Age of measurements, control periods.
    pub(super) fn delay(&self) -> usize {
        self.delay
    }

    /// Control periods since the episode began, up to one more than the delay.
    pub(super) fn periods<L: Lane>(&self, memory: &[L]) -> L {
        memory[COUNT]
    }

    /// Numbers of memory per instance.
    pub fn memory(&self) -> usize {
        self.references() + (self.delay + 1) * 2 * self.plant.joints()
    }

    /// Names and lengths of the blocks of memory. The disturbance is the sum of its slow and its wave part.
    pub fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        let n = 2 * self.plant.joints();
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
        ARM + 2 * self.plant.joints()
    }

    /// Place of the arm's references, that of the present first.
    fn references(&self) -> usize {
        self.commands() + (self.delay + 1) * 6
    }

    /// Updates the estimate by a measurement, and predicts the present.
    #[inline(always)]
    pub fn observe<L: Lane<Real = f64>>(
        &self,
        measured: &Measurement<L>,
        memory: &mut [L],
        scratch: &mut Scratch<L>,
    ) -> Estimate<L> {
        let n = self.plant.joints();
        let count = memory[COUNT];
        // At an episode's first instant the memory is empty.
        let first = count.lt(L::c(0.5));
        for slot in 0..=self.delay {
            let place = self.references() + 2 * n * slot;
            let reference = ArmMotion::load(memory, place, n);
            ArmMotion::select(first, &measured.arm, &reference).store(memory, place, n);
        }

        // The measurement is of the instant `delay` ago, which may lie before the episode.
        let later = L::c(self.delay as f64).lt(count);
        let mut motion = VehicleMotion { error: load(memory, MOTION), twist: load(memory, MOTION + 6) };
        let mut disturbance =
            Disturbance { slow: load(memory, DISTURBANCE), wave: [load(memory, WAVE), load(memory, WAVE + 6)] };
        let mut thrust = load(memory, THRUST);
        let (mut arm, mut next) = (ArmMotion::load(memory, ARM, n), measured.arm);
        // The arm moves as its reference does.
        let reference = ArmMotion::load(memory, self.references() + 2 * n * self.delay, n);
        let ahead = measured.reference.less(&reference).scale_add(L::c(1.0), &measured.arm);

        // To the instant of the measurement, period by period to the present, and by the horizon beyond.
        let mut innovation = Vector6::zero();
        let legs = self.delay + 1 + usize::from(self.horizon > 0.0);
        for leg in 0..legs {
            let beyond = leg > self.delay;
            let age = self.delay.saturating_sub(leg);
            let (carried, mean) = if beyond {
                let [wave, rate] = disturbance.wave;
                (disturbance, rate.scale_add(L::c(0.5 * self.horizon), wave) + disturbance.slow)
            } else {
                self.wave.carry(&disturbance)
            };
            let wrenches =
                AppliedWrenches { command: load(memory, self.commands() + 6 * age), thrust, disturbance: mean };
            let time = if beyond { self.horizon } else { self.period };
            if leg > 0 {
                let told = ArmMotion::load(memory, self.references() + 2 * n * age, n);
                arm = next;
                next = if beyond {
                    ahead.less(&arm).scale_add(L::c(self.horizon / self.period), &arm)
                } else {
                    told.less(&reference).scale_add(L::c(1.0), &measured.arm)
                };
            }
            let predicted = self.plant.predict(&motion, [&arm, &next], &wrenches, time, scratch);
            if beyond {
                motion = predicted.motion;
            } else if leg > 0 {
                let begun = L::c(age as f64 + 0.5).lt(count);
                motion = predicted.motion.or(begun, &motion);
                thrust = or(begun, predicted.thrust, thrust);
                disturbance = carried.or(begun, &disturbance);
            } else {
                innovation = measured.motion.twist - predicted.motion.twist;
                let (corrected, updated) = self.correct(measured, &predicted, &carried);
                motion = corrected.or(later, &measured.motion);
                thrust = or(later, predicted.thrust, thrust);
                disturbance = updated.or(later, &disturbance);
                store(memory, MOTION, motion.error);
                store(memory, MOTION + 6, motion.twist);
                store(memory, DISTURBANCE, disturbance.slow);
                store(memory, WAVE, disturbance.wave[0]);
                store(memory, WAVE + 6, disturbance.wave[1]);
                store(memory, THRUST, thrust);
                measured.arm.store(memory, ARM, n);
            }
        }
        let arms =
            if self.horizon > 0.0 { [next, ahead.less(&arm).scale_add(L::c(1.0), &next)] } else { [next, ahead] };
        let arm_innovation = measured.arm.less(&reference);
        Estimate {
            motion,
            arms,
            command: load(memory, self.commands()),
            thrust,
            disturbance,
            innovation,
            arm_innovation,
        }
    }

    /// Correction of a prediction by a measurement.
    #[inline(always)]
    fn correct<L: Lane<Real = f64>>(
        &self,
        measured: &Measurement<L>,
        predicted: &Prediction<L>,
        carried: &Disturbance<L>,
    ) -> (VehicleMotion<L>, Disturbance<L>) {
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
        let disturbance = Disturbance {
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
    pub fn remember<L: Lane<Real = f64>>(&self, measured: &Measurement<L>, command: Vector6<L>, memory: &mut [L]) {
        let n = 2 * self.plant.joints();
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

/// Six numbers of memory.
#[inline(always)]
fn load<L: Lane>(memory: &[L], place: usize) -> Vector6<L> {
    let mut all = [L::zero(); 6];
    all.copy_from_slice(&memory[place..place + 6]);
    Vector6::from_array(all)
}

#[inline(always)]
fn store<L: Lane>(memory: &mut [L], place: usize, x: Vector6<L>) {
    memory[place..place + 6].copy_from_slice(&x.to_array());
}

/// `yes` where the mask holds, else `no`.
#[inline(always)]
fn or<L: Lane>(mask: L::Mask, yes: Vector6<L>, no: Vector6<L>) -> Vector6<L> {
    let (yes, mut all) = (yes.to_array(), no.to_array());
    for k in 0..6 {
        all[k] = L::select(mask, yes[k], all[k]);
    }
    Vector6::from_array(all)
}

impl<L: Lane> VehicleMotion<L> {
    /// This where the mask holds, else the other.
    #[inline(always)]
    fn or(&self, mask: L::Mask, other: &Self) -> Self {
        Self { error: or(mask, self.error, other.error), twist: or(mask, self.twist, other.twist) }
    }
}

impl<L: Lane> ArmMotion<L> {
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

//! What a controller makes of measurements that come late, with its own past actions and the nominal model.

use super::filter::{Correction, Expected, STATES, Swell};
use super::plant::{Arm, Motion, Plant, Push, Reached};
use crate::control::pd::check_gains;
use crate::description::Scene;
use crate::dynamics::aba::Scratch;
use crate::error::ControlError;
use crate::lane::Lane;
use crate::lie::Vector6;
use crate::system::JOINTS;

/// What is measured at a row of observations.
#[derive(Debug, Clone, Copy)]
pub struct Seen<L> {
    /// Vehicle.
    pub motion: Motion<L>,
    /// Arm.
    pub arm: Arm<L>,
    /// Where the arm is to be at the next control instant. This is not late.
    pub reference: Arm<L>,
}

/// The present as a controller sees it.
#[derive(Debug, Clone, Copy)]
pub struct Estimate<L> {
    /// Vehicle, after the lead.
    pub motion: Motion<L>,
    /// Arm, likewise, and a control period later.
    pub arms: [Arm<L>; 2],
    /// Wrench of the thrusters that was asked for last,
    pub command: Vector6<L>,
    /// and as it is.
    pub thrust: Vector6<L>,
    /// What the model does not explain.
    pub unexplained: Unexplained<L>,
}

/// Wrenches that the model does not explain, as they are at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unexplained<L> {
    /// What stays, as far as one can tell.
    pub drift: Vector6<L>,
    /// What comes and goes as waves do, and its rate.
    pub wave: [Vector6<L>; 2],
}

impl<L: Lane> Unexplained<L> {
    /// This where the mask holds, else the other.
    #[inline(always)]
    fn or(&self, mask: L::Mask, other: &Self) -> Self {
        let [wave, rate] = self.wave;
        let wave = [or(mask, wave, other.wave[0]), or(mask, rate, other.wave[1])];
        Self { drift: or(mask, self.drift, other.drift), wave }
    }
}

impl Swell {
    /// What becomes of a wave.
    #[inline(always)]
    pub(super) fn after<L: Lane<Real = f64>>(&self, [wave, rate]: [Vector6<L>; 2]) -> [Vector6<L>; 2] {
        let [[a, b], [c, d]] = self.0;
        [wave.scale_add(L::c(a), rate.scale(L::c(b))), wave.scale_add(L::c(c), rate.scale(L::c(d)))]
    }

    /// What becomes of it all, and its mean until then.
    #[inline(always)]
    fn carry<L: Lane<Real = f64>>(&self, now: &Unexplained<L>) -> (Unexplained<L>, Vector6<L>) {
        let wave = self.after(now.wave);
        let mean = (now.wave[0] + wave[0]).scale_add(L::c(0.5), now.drift);
        (Unexplained { drift: now.drift, wave }, mean)
    }
}

/// What an observer expects, and how fast it follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observing {
    /// Bandwidth of the observer of what stays, linear and angular, rad/s; 0: none.
    pub observer: [f64; 2],
    /// Deviation of accelerations that come and go with the waves, linear and angular, m/s2 and rad/s2.
    pub waves: [f64; 2],
    /// Their angular frequency, rad/s.
    pub frequency: f64,
    /// White noise on accelerations, linear and angular, m/s2 and rad/s2 times the root of a second. Where this and
    /// `waves` are 0 measurements are taken as they are; else a Kalman filter weighs them.
    pub jolts: [f64; 2],
    /// Age of measurements in control periods, which the model bridges.
    pub delay: usize,
}

/// An observer of the vehicle's momentum.
///
/// From its last estimate it predicts the measurement that comes, with the wrench of what it asked for then, through the
/// thrusters' lag; what differs corrects the estimate, above all that of the disturbance. Measurements are taken to be
/// `delay` control periods old: from the estimate then the model goes on to the present, and for the lead beyond.
#[derive(Debug, Clone, PartialEq)]
pub struct Observer {
    plant: Plant,
    /// Control period, s.
    period: f64,
    delay: usize,
    /// Time beyond the present for which the model goes on, s.
    lead: f64,
    /// Per axis.
    corrections: [Correction; 6],
    swell: Swell,
}

/// Places in a row of memory.
const COUNT: usize = 0;
const MOTION: usize = 1;
const DISTURBANCE: usize = 13;
const THRUST: usize = 19;
const WAVE: usize = 25;
const ARM: usize = 37;

impl Observer {
    /// For a checked scene that is measured and acted on every `period` s.
    ///
    /// # Errors
    /// `ControlError::Gain` for a gain that is not finite or is negative.
    pub fn new(by: Observing, lead: f64, scene: &Scene, period: f64) -> Result<Self, ControlError> {
        check_gains("observer", &by.observer)?;
        check_gains("waves", &by.waves)?;
        check_gains("frequency", &[by.frequency])?;
        check_gains("jolts", &by.jolts)?;
        check_gains("lead", &[lead])?;
        let correction = [0, 1].map(|k| {
            let expected = Expected { drift: by.observer[k], waves: by.waves[k], jolts: by.jolts[k] };
            if expected.waves == 0.0 && expected.jolts == 0.0 {
                Correction::momentum(expected.drift, period)
            } else {
                Correction::kalman(&expected, by.frequency, period)
            }
        });
        Ok(Self {
            plant: Plant::new(scene),
            period,
            delay: by.delay,
            lead,
            corrections: std::array::from_fn(|k| correction[k / 3]),
            swell: Swell::over(by.frequency, period),
        })
    }

    /// The nominal model.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Control period, s.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// Numbers remembered per instance.
    pub fn memory(&self) -> usize {
        self.references() + (self.delay + 1) * 2 * self.plant.joints()
    }

    /// Place of the wrenches asked for, the latest first.
    fn commands(&self) -> usize {
        ARM + 2 * self.plant.joints()
    }

    /// Place of the arm's references, the one for the present first.
    fn references(&self) -> usize {
        self.commands() + (self.delay + 1) * 6
    }

    /// Takes a measurement into account, and tells of the present.
    #[inline(always)]
    pub fn observe<L: Lane<Real = f64>>(
        &self,
        seen: &Seen<L>,
        memory: &mut [L],
        scratch: &mut Scratch<L>,
    ) -> Estimate<L> {
        let n = self.plant.joints();
        let count = memory[COUNT];
        // Nothing was remembered before an episode's first instant.
        let first = count.lt(L::c(0.5));
        for slot in 0..=self.delay {
            let place = self.references() + 2 * n * slot;
            let reference = Arm::remembered(memory, place, n);
            Arm::select(first, &seen.arm, &reference).remember(memory, place, n);
        }

        // The measurement is of the instant `delay` ago; there was none before the episode began.
        let later = L::c(self.delay as f64).lt(count);
        let mut motion = Motion { error: six(memory, MOTION), twist: six(memory, MOTION + 6) };
        let mut unexplained =
            Unexplained { drift: six(memory, DISTURBANCE), wave: [six(memory, WAVE), six(memory, WAVE + 6)] };
        let mut thrust = six(memory, THRUST);
        let (mut arm, mut next) = (Arm::remembered(memory, ARM, n), seen.arm);
        // The arm moves as its reference does.
        let reference = Arm::remembered(memory, self.references() + 2 * n * self.delay, n);
        let ahead = seen.reference.less(&reference).scale_add(L::c(1.0), &seen.arm);

        // Up to that instant, on to the present period by period, and on for the lead.
        let legs = self.delay + 1 + usize::from(self.lead > 0.0);
        for leg in 0..legs {
            let beyond = leg > self.delay;
            let age = self.delay.saturating_sub(leg);
            let (carried, disturbance) = if beyond {
                let [wave, rate] = unexplained.wave;
                (unexplained, rate.scale_add(L::c(0.5 * self.lead), wave) + unexplained.drift)
            } else {
                self.swell.carry(&unexplained)
            };
            let push = Push { command: six(memory, self.commands() + 6 * age), thrust, disturbance };
            let time = if beyond { self.lead } else { self.period };
            if leg > 0 {
                let told = Arm::remembered(memory, self.references() + 2 * n * age, n);
                arm = next;
                next = if beyond {
                    ahead.less(&arm).scale_add(L::c(self.lead / self.period), &arm)
                } else {
                    told.less(&reference).scale_add(L::c(1.0), &seen.arm)
                };
            }
            let reached = self.plant.advance(&motion, [&arm, &next], &push, time, scratch);
            if beyond {
                motion = reached.motion;
            } else if leg > 0 {
                let begun = L::c(age as f64 + 0.5).lt(count);
                motion = reached.motion.or(begun, &motion);
                thrust = or(begun, reached.thrust, thrust);
                unexplained = carried.or(begun, &unexplained);
            } else {
                let (corrected, explained) = self.correct(seen, &reached, &carried);
                motion = corrected.or(later, &seen.motion);
                thrust = or(later, reached.thrust, thrust);
                unexplained = explained.or(later, &unexplained);
                put(memory, MOTION, motion.error);
                put(memory, MOTION + 6, motion.twist);
                put(memory, DISTURBANCE, unexplained.drift);
                put(memory, WAVE, unexplained.wave[0]);
                put(memory, WAVE + 6, unexplained.wave[1]);
                put(memory, THRUST, thrust);
                seen.arm.remember(memory, ARM, n);
            }
        }
        let arms = if self.lead > 0.0 { [next, ahead.less(&arm).scale_add(L::c(1.0), &next)] } else { [next, ahead] };
        Estimate { motion, arms, command: six(memory, self.commands()), thrust, unexplained }
    }

    /// What a measurement makes of the prediction.
    #[inline(always)]
    fn correct<L: Lane<Real = f64>>(
        &self,
        seen: &Seen<L>,
        reached: &Reached<L>,
        carried: &Unexplained<L>,
    ) -> (Motion<L>, Unexplained<L>) {
        let Reached { motion, inertia, .. } = reached;
        let missed = (seen.motion.error - motion.error).to_array();
        let missed_twist = (seen.motion.twist - motion.twist).to_array();
        let mut parts = [[L::zero(); 6]; STATES];
        for k in 0..6 {
            for i in 0..STATES {
                let [by_error, by_twist] = self.corrections[k].0[i];
                parts[i][k] = L::c(by_twist).mul_add(missed_twist[k], L::c(by_error) * missed[k]);
            }
        }
        let motion = Motion {
            error: motion.error + Vector6::from_array(parts[0]),
            twist: motion.twist + Vector6::from_array(parts[1]),
        };
        let unexplained = Unexplained {
            drift: carried.drift + inertia.apply(Vector6::from_array(parts[2])),
            wave: [
                carried.wave[0] + inertia.apply(Vector6::from_array(parts[3])),
                carried.wave[1] + inertia.apply(Vector6::from_array(parts[4])),
            ],
        };
        (motion, unexplained)
    }

    /// Remembers the wrench of the thrusts that were asked for, and where the arm was told to go.
    #[inline(always)]
    pub fn remember<L: Lane<Real = f64>>(&self, seen: &Seen<L>, command: Vector6<L>, memory: &mut [L]) {
        let n = 2 * self.plant.joints();
        let (commands, references) = (self.commands(), self.references());
        memory[commands..references].rotate_right(6);
        put(memory, commands, command);
        if n > 0 {
            memory[references..].rotate_right(n);
            seen.reference.remember(memory, references, n / 2);
        }
        memory[COUNT] = (memory[COUNT] + L::c(1.0)).min(L::c(self.delay as f64 + 1.0));
    }
}

/// Six numbers remembered.
#[inline(always)]
fn six<L: Lane>(memory: &[L], place: usize) -> Vector6<L> {
    let mut all = [L::zero(); 6];
    all.copy_from_slice(&memory[place..place + 6]);
    Vector6::from_array(all)
}

#[inline(always)]
fn put<L: Lane>(memory: &mut [L], place: usize, x: Vector6<L>) {
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

impl<L: Lane> Motion<L> {
    /// This where the mask holds, else the other.
    #[inline(always)]
    fn or(&self, mask: L::Mask, other: &Self) -> Self {
        Self { error: or(mask, self.error, other.error), twist: or(mask, self.twist, other.twist) }
    }
}

impl<L: Lane> Arm<L> {
    #[inline(always)]
    fn select(mask: L::Mask, yes: &Self, no: &Self) -> Self {
        let mut arm = *no;
        for i in 0..JOINTS {
            arm.q[i] = L::select(mask, yes.q[i], no.q[i]);
            arm.qd[i] = L::select(mask, yes.qd[i], no.qd[i]);
        }
        arm
    }

    #[inline(always)]
    fn remembered(memory: &[L], place: usize, n: usize) -> Self {
        let mut arm = Self { q: [L::zero(); JOINTS], qd: [L::zero(); JOINTS] };
        for i in 0..n {
            (arm.q[i], arm.qd[i]) = (memory[place + i], memory[place + n + i]);
        }
        arm
    }

    #[inline(always)]
    fn remember(&self, memory: &mut [L], place: usize, n: usize) {
        for i in 0..n {
            (memory[place + i], memory[place + n + i]) = (self.q[i], self.qd[i]);
        }
    }
}

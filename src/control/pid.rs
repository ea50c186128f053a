//! The paper's PD with an integral, from observations alone.

use super::controller::{Controller, Widths};
use super::pd::check_gains;
use super::{ACTIONS, Actuation, Pd};
use crate::error::ControlError;
use crate::lane::{Isa, Kernel, Lane, Real};

/// Integral time over derivative time, `T_i / T_d`, where no integral gains are given.
const INTEGRAL_RATIO: f64 = 2.0;
/// An axis falls short where it misses more than this share of its limit: actions are rounded to f32.
const MISSED: f64 = 1e-4;

/// PID on the vehicle, `F = -kp e - kd V - ki z` with `z' = e`: [`Pd`] and an integral of the pose error, which takes
/// out what a current or a weight leaves of it.
///
/// The integral is the policy's memory, not the observation's leaky one, which by its leak holds no constant wrench
/// without error. Against windup it waits (conditional integration) on every axis whose wrench the thrusters do not
/// reach, for as long as the error would drive it further that way; the allocation tells what they reach.
#[derive(Debug, Clone, PartialEq)]
pub struct Pid {
    pd: Pd,
    actuation: Actuation<f64>,
    ki: [f64; 6],
    /// Control period, s.
    period: f64,
}

impl Pid {
    /// A PID that acts every `period` s. Without integral gains `T_i = 2 T_d`: `ki = kp / T_i` with `T_d = kd / kp`, so
    /// `ki = kp^2 / (2 kd)`. On a critically damped PD, as the scenes have it, the slowest poles then have a damping
    /// ratio of 0.69, and `ki` is an eighth of what an axis stands.
    ///
    /// # Errors
    /// `ControlError::Gain` for a gain that is not finite or is negative.
    pub fn new(pd: Pd, ki: Option<[f64; 6]>, period: f64) -> Result<Self, ControlError> {
        let (kp, kd) = (&pd.gains().kp, &pd.gains().kd);
        let rule = |k: usize| if kd[k] > 0.0 { kp[k] * kp[k] / (INTEGRAL_RATIO * kd[k]) } else { 0.0 };
        let ki = ki.unwrap_or_else(|| std::array::from_fn(rule));
        check_gains("ki", &ki)?;
        Ok(Self { actuation: Actuation::new(pd.actions()), pd, ki, period })
    }

    /// Its proportional and derivative part.
    pub fn pd(&self) -> &Pd {
        &self.pd
    }

    /// Integral gains, N/(m s) and N m/(rad s).
    pub fn ki(&self) -> &[f64; 6] {
        &self.ki
    }

    /// One action, and the integral that follows.
    #[inline(always)]
    fn control(&self, observation: &[f32], integral: &mut [f64], action: &mut [f32]) {
        let actions = self.pd.actions();
        let mut wrench = self.pd.wrench(observation);
        for k in 0..6 {
            wrench[k] -= self.ki[k] * integral[k];
        }
        actions.normalise(&wrench, action);
        let mut entries = [0.0; ACTIONS];
        entries.iter_mut().zip(&*action).for_each(|(entry, a)| *entry = f64::from(*a));
        let reached = self.actuation.act(&entries).wrench.to_array();
        let (error, limits) = (self.pd.error(observation), actions.allocation().wrench_limits());
        for k in 0..6 {
            let short = (wrench[k] - reached[k]) * wrench[k].signum() > MISSED * limits[k];
            let further = error[k] * wrench[k] < 0.0;
            if !(short && further) {
                integral[k] += self.period * error[k];
            }
        }
    }
}

impl Controller for Pid {
    fn widths(&self) -> Widths {
        Widths { memory: 6, ..self.pd.widths() }
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().rows(observations, memory, actions)?;
        // An instruction set that cannot be had is not this one's to complain of.
        f64::dispatch(Isa::best().unwrap_or(Isa::Plain), &mut Rows { pid: self, observations, memory, actions });
        Ok(())
    }
}

/// Rows that are to be acted on: one by one, but with the machine's own multiply-add.
struct Rows<'a> {
    pid: &'a Pid,
    observations: &'a [f32],
    memory: &'a mut [f64],
    actions: &'a mut [f32],
}

impl Kernel<f64> for Rows<'_> {
    #[inline(always)]
    fn run<L: Lane<Real = f64>>(&mut self) {
        let Widths { observation, memory, action } = self.pid.widths();
        let rows = self.observations.chunks_exact(observation).zip(self.memory.chunks_exact_mut(memory));
        for ((observation, integral), action) in rows.zip(self.actions.chunks_exact_mut(action.max(1))) {
            self.pid.control(observation, integral, action);
        }
    }
}

//! PID station keeping.

use serde::{Deserialize, Serialize};

use super::controller::{Controller, Widths};
use super::gains::{self, GainMap};
use super::indices::ObservationIndices;
use super::{ACTIONS, ActionMap, Actuation, Pd};
use crate::description::VehicleServo;
use crate::error::ControlError;
use crate::lane::{Isa, Kernel, Lane, Real};

/// Integral time over derivative time, `T_i / T_d`, of the default integral gains.
const INTEGRAL_RATIO: f64 = 2.0;
/// Share of an axis's limit beyond which a missing wrench counts as saturation: actions are rounded to f32.
const MISSED: f64 = 1e-4;

/// Gains of [`Pid`], per body axis `[x y z; roll pitch yaw]`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct PidGains {
    /// Proportional gains, N/m and N m/rad.
    pub kp: [f64; 6],
    /// Derivative gains, N s/m and N m s/rad.
    pub kd: [f64; 6],
    /// Integral gains, N/(m s) and N m/(rad s).
    pub ki: [f64; 6],
}

impl PidGains {
    /// Integral gains by `T_i = 2 T_d`: `ki = kp / T_i` with `T_d = kd / kp`, so `ki = kp^2 / (2 kd)`. On a critically
    /// damped PD, as the scenes have it, the slowest poles then have a damping ratio of 0.69, and `ki` is an eighth of
    /// the stability limit.
    pub fn from_pd(VehicleServo { kp, kd }: VehicleServo) -> Self {
        let rule = |k: usize| if kd[k] > 0.0 { kp[k] * kp[k] / (INTEGRAL_RATIO * kd[k]) } else { 0.0 };
        Self { kp, kd, ki: std::array::from_fn(rule) }
    }
}

/// PID on the vehicle, `F = -kp e - kd V - ki z` with `z' = e`: [`Pd`] and an integral of the pose error, which removes
/// the steady-state offset under a current or a weight.
///
/// The integral is the controller's memory, not the observation's leaky one, which cannot balance a constant wrench
/// without error. Against windup it pauses (conditional integration) on every axis whose wrench the thrusters do not
/// reach, for as long as the error would drive it further that way; the allocation gives the wrench that they reach.
#[derive(Debug, Clone, PartialEq)]
pub struct Pid {
    pd: Pd,
    actuation: Actuation<f64>,
    gains: PidGains,
    /// Control period, s.
    period: f64,
}

impl Pid {
    /// A PID that acts every `period` s.
    ///
    /// # Errors
    /// `ControlError::Gain` for a gain that is not finite or is negative.
    pub fn new(
        indices: ObservationIndices,
        gains: PidGains,
        actions: ActionMap,
        period: f64,
    ) -> Result<Self, ControlError> {
        gains::check(&gains)?;
        let (actuation, servo) = (Actuation::new(&actions), VehicleServo { kp: gains.kp, kd: gains.kd });
        Ok(Self { pd: Pd::new(indices, servo, actions)?, actuation, gains, period })
    }

    /// One action, and the integral that follows.
    #[inline(always)]
    fn control(&self, observation: &[f32], integral: &mut [f64], action: &mut [f32]) {
        let actions = self.pd.actions();
        let mut wrench = self.pd.wrench(observation);
        for k in 0..6 {
            wrench[k] -= self.gains.ki[k] * integral[k];
        }
        actions.normalise(&wrench, action);
        let mut entries = [0.0; ACTIONS];
        for k in 0..action.len() {
            entries[k] = f64::from(action[k]);
        }
        let reached = self.actuation.act(&entries).wrench.to_array();
        let (error, limits) = (self.pd.error(observation), actions.allocation().wrench_limits());
        for k in 0..6 {
            let saturated = (wrench[k] - reached[k]) * wrench[k].signum() > MISSED * limits[k];
            let further = error[k] * wrench[k] < 0.0;
            if !(saturated && further) {
                integral[k] += self.period * error[k];
            }
        }
    }
}

impl Controller for Pid {
    fn widths(&self) -> Widths {
        Widths { memory: 6, ..self.pd.widths() }
    }

    fn gains(&self) -> GainMap {
        gains::to_map(&self.gains)
    }

    fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        vec![("integral", 6)]
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().rows(observations, memory, actions)?;
        // An unavailable instruction set is reported elsewhere.
        f64::dispatch(Isa::best().unwrap_or(Isa::Plain), &mut Rows { pid: self, observations, memory, actions });
        Ok(())
    }
}

/// Rows one by one, with the machine's own multiply-add.
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
        for row in 0..self.observations.len() / observation {
            let integral = &mut self.memory[row * memory..][..memory];
            let action = &mut self.actions[row * action..][..action];
            self.pid.control(&self.observations[row * observation..][..observation], integral, action);
        }
    }
}

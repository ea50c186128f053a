//! PID station keeping.

use serde::{Deserialize, Serialize};

use super::controller::{Controller, Widths};
use super::indices::ObservationIndices;
use super::rows::{LaneLaw, Work};
use super::{ActionMap, Actuation, Pd};
use crate::description::VehicleServo;
use crate::error::ControlError;
use crate::lane::Lane;

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
    /// Integral gains.
    ki: [f64; 6],
    /// Control period, s.
    period: f64,
}

impl Pid {
    /// A PID that acts every `period` s.
    pub fn new(indices: ObservationIndices, gains: PidGains, actions: ActionMap, period: f64) -> Self {
        let PidGains { kp, kd, ki } = gains;
        let actuation = Actuation::new(&actions);
        Self { pd: Pd::new(indices, VehicleServo { kp, kd }, actions), actuation, ki, period }
    }
}

impl LaneLaw for Pid {
    /// Rows one by one, with the machine's own multiply-add.
    #[inline(always)]
    fn control<L: Lane<Real = f64>>(
        &self,
        observations: &[f32],
        memory: &mut [f64],
        actions: &mut [f32],
        _: &mut Work<L>,
    ) {
        let (map, Widths { observation, action: width, .. }) = (&self.pd.actions, self.widths());
        let limits = map.allocation().wrench_limits();
        for row in 0..observations.len() / observation {
            let observation = &observations[row * observation..][..observation];
            let (integral, action) = (&mut memory[6 * row..][..6], &mut actions[row * width..][..width]);
            let mut wrench = self.pd.wrench(observation);
            for k in 0..6 {
                wrench[k] -= self.ki[k] * integral[k];
            }
            map.normalise(&wrench, &[], action);
            let (error, reached) = (self.pd.error(observation), self.actuation.act_on_row(action).wrench.to_array());
            for k in 0..6 {
                let saturated = (wrench[k] - reached[k]) * wrench[k].signum() > MISSED * limits[k];
                let further = error[k] * wrench[k] < 0.0;
                if !(saturated && further) {
                    integral[k] += self.period * error[k];
                }
            }
        }
    }
}

impl Controller for Pid {
    #[inline(always)]
    fn widths(&self) -> Widths {
        Widths { memory: 6, ..self.pd.widths() }
    }

    fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        vec![("integral", 6)]
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.act_in_lanes(observations, memory, actions)
    }
}

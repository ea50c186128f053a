//! PD: station keeping, and docking with a limited approach speed.

use serde::{Deserialize, Serialize};

use super::ActionMap;
use super::controller::{Controller, Widths};
use super::indices::ObservationIndices;
use super::nominal_model::VehicleMotion;
use crate::description::VehicleServo;
use crate::error::ControlError;
use crate::lane::Lane;
use crate::lie::Vector6;

/// Gains of [`Pd::docking`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DockPdGains {
    /// Proportional gains, N/m and N m/rad.
    pub kp: [f64; 6],
    /// Derivative gains, N s/m and N m s/rad.
    pub kd: [f64; 6],
    /// Maximum speed of approach, m/s.
    pub approach_speed: f64,
    /// Maximum angular speed of approach, rad/s.
    pub turn_speed: f64,
    /// Distances of the aim beyond the docking pose, forward and downward: they press the vehicle on the dock, m.
    pub press: [f64; 2],
    /// Maximum height of the aim in front of the dock, m.
    pub lift: f64,
    /// Rise of the aim with the distance in front of the dock, m/m.
    pub glide_slope: f64,
    /// Retreat of the aim for errors aside or downward beyond the clearance, m/m.
    pub retreat: f64,
    /// Error aside or downward without retreat, m.
    pub clearance: f64,
}

impl DockPdGains {
    /// Gains of a vehicle's PD with the default speeds of approach.
    pub fn from_pd(VehicleServo { kp, kd }: VehicleServo) -> Self {
        let (lift, glide_slope, retreat, clearance) = (0.0, 0.0, 0.0, 0.0);
        Self { kp, kd, approach_speed: 0.5, turn_speed: 0.3, press: [0.0; 2], lift, glide_slope, retreat, clearance }
    }

    /// The gains for a dock that the vehicle touches.
    pub fn onto_cradle(self) -> Self {
        Self { press: [0.15, 0.1], lift: 0.15, glide_slope: 0.5, retreat: 3.0, clearance: 0.05, ..self }
    }

    /// Pose error from the aim: for a vehicle in front of the dock, it lies above the docking pose, and further in front of it the
    /// further aside the vehicle is; for a docked vehicle, it lies beyond the docking pose.
    #[inline(always)]
    fn aim_error(&self, mut error: [f64; 6]) -> [f64; 6] {
        let [forward, downward] = self.press;
        let height = (self.glide_slope * (-error[0]).max(0.0) - downward).min(self.lift);
        error[2] -= height;
        let below = error[2].min(0.0);
        let aside = (error[1] * error[1] + below * below).sqrt();
        error[0] += self.retreat * (aside - self.clearance).max(0.0) - forward;
        error
    }
}

impl Default for DockPdGains {
    fn default() -> Self {
        Self::from_pd(VehicleServo::default())
    }
}

/// PD on the vehicle, `F = -kp e - kd V` `[HC sec. 5.2]`, with the attitude error "log" of the observations: the rotation
/// vector `log(R_d^T R)`. The vehicle's servo within the stages, which a pose target turns on, uses "vee":
/// `vee(R_d^T R - R^T R_d) / 2`. Joints have PD servos of their own, which belong to the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Pd {
    indices: ObservationIndices,
    pub(super) gains: VehicleServo,
    docking: Option<DockPdGains>,
    pub(super) actions: ActionMap,
}

impl Pd {
    /// A PD that reads observations at `indices` and gives actions of `actions`.
    pub fn new(indices: ObservationIndices, gains: VehicleServo, actions: ActionMap) -> Self {
        Self { indices, gains, docking: None, actions }
    }

    /// PD on a clipped error: `F = -kp sat(e) - kd V_r` with the pose error e from the aim and the twist V_r relative to the dock,
    /// which feeds the dock's velocity forward. `sat` scales the error's linear and angular parts down together where the
    /// velocity at which both terms balance, `-kp e / kd`, is above the speed of approach.
    pub fn docking(indices: ObservationIndices, gains: DockPdGains, actions: ActionMap) -> Self {
        let servo = VehicleServo { kp: gains.kp, kd: gains.kd };
        Self { docking: Some(gains), ..Self::new(indices, servo, actions) }
    }

    /// Pose error (m, rad) at one row of observations.
    #[inline(always)]
    pub(super) fn error(&self, observation: &[f32]) -> [f64; 6] {
        self.indices.error.six(observation)
    }

    /// Body wrench (N, N m) at one row of observations.
    #[inline(always)]
    pub fn wrench(&self, observation: &[f32]) -> nalgebra::Vector6<f64> {
        let VehicleServo { kp, kd } = &self.gains;
        let (mut error, twist) = (self.error(observation), self.indices.twist.six(observation));
        let mut scales = [1.0; 2];
        if let Some(docking) = &self.docking {
            error = docking.aim_error(error);
            let speeds = [docking.approach_speed, docking.turn_speed];
            for part in 0..2 {
                let balance = |k: usize| if kd[k] > 0.0 { kp[k] * error[k] / kd[k] } else { 0.0 };
                let speed = (3 * part..3 * part + 3).map(balance).map(|v| v * v).sum::<f64>().sqrt();
                scales[part] = if speed > speeds[part] { speeds[part] / speed } else { 1.0 };
            }
        }
        nalgebra::Vector6::from_fn(|k, _| -kp[k] * scales[k / 3] * error[k] - kd[k] * twist[k])
    }
}

impl VehicleServo {
    /// `-kp e - kd V`
    #[inline(always)]
    pub(super) fn feedback<L: Lane<Real = f64>>(&self, motion: &VehicleMotion<L>) -> Vector6<L> {
        let (error, twist, mut wrench) = (motion.error.to_array(), motion.twist.to_array(), [L::zero(); 6]);
        for k in 0..6 {
            let damped = L::c(self.kd[k]) * twist[k];
            wrench[k] = -L::c(self.kp[k]).mul_add(error[k], damped);
        }
        Vector6::from_array(wrench)
    }
}

impl Controller for Pd {
    #[inline(always)]
    fn widths(&self) -> Widths {
        Widths { observation: self.indices.width, memory: 0, action: self.actions.len() }
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().each_row(observations, memory, actions, |observation, _, action| {
            self.actions.normalise(&self.wrench(observation), &[], action);
        })
    }
}

//! Station keeping with a disturbance observer: PD, and computed torque.

use serde::{Deserialize, Serialize};

use super::kalman::WaveTransition;
use super::observer::{Observer, ObserverEstimate, ObserverGains};
use crate::description::VehicleServo;
use crate::dynamics::CompositeBody;
use crate::lane::Lane;
use crate::lie::Vector6;

/// Gains of DOB and of computed torque.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FeedbackGains {
    /// Proportional gains, N/m and N m/rad; for computed torque 1/s2.
    pub kp: [f64; 6],
    /// Derivative gains, N s/m and N m s/rad; for computed torque 1/s.
    pub kd: [f64; 6],
    /// Gains of the observer.
    #[serde(flatten)]
    pub observer: ObserverGains,
    /// Time beyond the present for which the model predicts before the feedback, s: the thrusters' lag.
    pub prediction_horizon: f64,
}

impl FeedbackGains {
    /// Default gains, with these of a PD.
    pub fn new(VehicleServo { kp, kd }: VehicleServo, observer: ObserverGains) -> Self {
        Self { kp, kd, observer, prediction_horizon: 0.0 }
    }
}

/// `F = -kp e - kd V - f - d`: a PD on wrenches that compensates the force f of weight, buoyancy and damping, and the
/// observed disturbance d.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Dob {
    servo: VehicleServo,
    /// Transition of the waves from now to when a command acts.
    wave: WaveTransition,
}

impl Dob {
    pub fn new(gains: &FeedbackGains, observer: &Observer) -> Self {
        // A command acts half a period and a lag later.
        let time = 0.5 * observer.period() + observer.model().lag();
        let servo = VehicleServo { kp: gains.kp, kd: gains.kd };
        Self { servo, wave: WaveTransition::over(gains.observer.wave_frequency, time) }
    }

    /// Disturbance when the command acts.
    #[inline(always)]
    fn disturbance<L: Lane<Real = f64>>(&self, at: &ObserverEstimate<L>) -> Vector6<L> {
        let [wave, _] = self.wave.after(at.disturbance.wave);
        at.disturbance.slow + wave
    }

    /// Wrench for an estimate and the composite body at it.
    #[inline(always)]
    pub fn wrench<L: Lane<Real = f64>>(&self, at: &ObserverEstimate<L>, body: &CompositeBody<L>) -> Vector6<L> {
        self.servo.feedback(&at.motion) - body.force - self.disturbance(at)
    }

    /// Computed torque `F = M a + (h(q^+, q'^+) - h(q, q')) / T + V x* h - f - d` with `a = -kp e - kd V`, and the momentum h at
    /// the arm's references for the next control instant, for the composite bodies at an estimate and a control period T later.
    /// `[HC eq. 13]`
    #[inline(always)]
    pub fn computed_torque<L: Lane<Real = f64>>(
        &self,
        at: &ObserverEstimate<L>,
        [now, next]: &[CompositeBody<L>; 2],
        period: f64,
    ) -> Vector6<L> {
        let steady = now.momentum_transport(at.motion.twist) - now.force - self.disturbance(at);
        let wrench =
            now.momentum.scale_add(L::c(-1.0 / period), now.inertia.apply(self.servo.feedback(&at.motion)) + steady);
        next.momentum.scale_add(L::c(1.0 / period), wrench)
    }
}

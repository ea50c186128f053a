//! Gains of NMPC.

use nalgebra::DVector;
use serde::{Deserialize, Serialize};

use crate::control::indices::ATTITUDE_LEVER;
use crate::control::observer::ObserverGains;
use crate::control::resolved_motion::ResolvedMotionGains;
use crate::control::thrusts::{MIN_EFFORT, RelativeThrusts};

/// Gains of NMPC: weights of the cost, and gains of the observer. Lists of three: linear, angular, joints; angles count
/// by [`ATTITUDE_LEVER`](crate::control::ATTITUDE_LEVER).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NmpcGains {
    /// On the vehicle's velocities and the joints' rates, s2.
    pub velocity: [f64; 3],
    /// On forces, moments and torques beyond the compensation of the model's forces and of disturbances, over their
    /// limits, m2.
    pub effort: [f64; 3],
    /// On the change of forces and moments: the command minus the thrusters' present wrench, over their limits, m2.
    pub change: [f64; 2],
    /// On the distance of joints from home, m2; in tracking only.
    pub posture: f64,
    /// On the tilt of the vehicle, m2; in tracking only.
    pub levelling: f64,
    /// Bandwidths of the observer, rad/s: of forces, moments and, in tracking, torques on joints.
    pub observer_bandwidth: [f64; 3],
    /// As in [`ObserverGains`], in station keeping only: wave accelerations, m/s2 and rad/s2,
    pub wave_acceleration: [f64; 2],
    /// frequency of the waves, rad/s,
    pub wave_frequency: f64,
    /// and noise on accelerations, m/s2 and rad/s2 times the root of a second.
    pub acceleration_noise: [f64; 2],
    /// Age of measurements, control periods.
    pub delay: usize,
}

impl Default for NmpcGains {
    fn default() -> Self {
        Self::station_keeping(0)
    }
}

impl NmpcGains {
    /// Default gains of station keeping: a Kalman filter with a wave model.
    pub fn station_keeping(delay: usize) -> Self {
        let ObserverGains { wave_acceleration, wave_frequency, acceleration_noise, .. } =
            ObserverGains::filtering(delay);
        Self {
            velocity: [0.02; 3],
            effort: [0.03, 0.06, 0.03],
            change: [0.01, 0.02],
            posture: 1e-6,
            levelling: 0.01,
            observer_bandwidth: [8.0; 3],
            wave_acceleration,
            wave_frequency,
            acceleration_noise,
            delay,
        }
    }

    /// Default gains of tracking.
    pub fn tracking(delay: usize) -> Self {
        let (velocity, effort, change) = ([0.05, 0.05, 0.01], [0.003, 0.003, 0.02], [0.003; 2]);
        let observer_bandwidth = [7.0, 7.0, 10.0];
        Self { velocity, effort, change, observer_bandwidth, ..Self::station_keeping(delay) }
    }

    /// Gains of the observer of station keeping.
    pub(in crate::control) fn observer(&self) -> ObserverGains {
        let [linear, angular, _] = self.observer_bandwidth;
        ObserverGains {
            observer_bandwidth: [linear, angular],
            wave_acceleration: self.wave_acceleration,
            wave_frequency: self.wave_frequency,
            acceleration_noise: self.acceleration_noise,
            delay: self.delay,
        }
    }

    /// Roots of a knot's cost of the vehicle: rows of weighted residuals of z, which has `entries`. Its first six are pose errors;
    /// velocities, the thrusters' wrench and relative thrusts follow at these places. Pose errors and velocities count along the
    /// axes of `counted`, efforts along the axes with a limit in `unit`.
    pub(super) fn roots(
        &self,
        thrusts: &RelativeThrusts,
        (counted, unit): ([bool; 6], &[f64; 6]),
        [velocity, wrench, inputs]: [usize; 3],
        entries: usize,
    ) -> Vec<DVector<f64>> {
        let over = |k: usize, weight: f64| if unit[k] > 0.0 { weight.sqrt() / unit[k] } else { 0.0 };
        let mut rows = Vec::new();
        for k in 0..6 {
            let lever = if k < 3 { 1.0 } else { ATTITUDE_LEVER } * f64::from(u8::from(counted[k]));
            let (effort, change) = (over(k, self.effort[k / 3].max(MIN_EFFORT)), over(k, self.change[k / 3]));
            let (mut four, per_thrust) = ([0; 4].map(|_| DVector::zeros(entries)), thrusts.wrench.row(k).transpose());
            four[0][k] = lever;
            four[1][velocity + k] = self.velocity[k / 3].sqrt() * lever;
            four[2].rows_mut(inputs, thrusts.count()).copy_from(&(&per_thrust * effort));
            four[3].rows_mut(inputs, thrusts.count()).copy_from(&(per_thrust * change));
            four[3][wrench + k] = -change;
            rows.extend(four);
        }
        for cancelling in thrusts.cancelling_root(self.effort.iter().chain(&self.change)).row_iter() {
            let mut row = DVector::zeros(entries);
            row.rows_mut(inputs, thrusts.count()).copy_from(&cancelling.transpose());
            rows.push(row);
        }
        rows
    }

    /// Gains of the observer of tracking.
    pub(super) fn predictor(&self) -> ResolvedMotionGains {
        let Self { observer_bandwidth, delay, .. } = *self;
        ResolvedMotionGains { observer_bandwidth, delay, ..ResolvedMotionGains::default() }
    }
}

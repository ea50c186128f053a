//! Motion of the estimate by the IMU's readings, and growth of its covariance.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::state::{ACCELEROMETER, ATTITUDE, FilterState, GYRO, PING, POSITION, Ping, STATES, VELOCITY};
use crate::sensors::{Imu, exponential};

/// Standard deviations of acceleration (m/s2) and angular velocity (rad/s) of a vehicle without readings. Both last, so
/// that the errors of velocity and attitude grow in proportion to the time.
const COASTING: [f64; 2] = [1.0, 1.0];
/// Time constant of the angular velocity then, s.
const FADING: f64 = 1.0;

/// Number of states of the motion.
const MOTION: usize = 9;

impl FilterState {
    /// Motion to a time by the mean specific force and angular velocity since the last one, and the angular velocity then,
    /// in vehicle axes. Without a reading the velocity in the world stays and the angular velocity fades, less certain.
    pub fn propagate(&mut self, imu: &Imu, time: f64, reading: Option<[Vector3<f64>; 3]>) {
        let period = time - self.time;
        if period <= 0.0 {
            return;
        }
        self.time = time;
        let Some([force, rate, latest]) = reading else {
            self.rate *= (-period / FADING).exp();
            let turn = self.rate * period;
            self.position += self.velocity * period;
            self.rotation = orthonormal(&(self.rotation * exponential(&turn)));
            let before = self.coasted;
            self.coasted += period;
            let grown = self.coasted * self.coasted - before * before;
            self.rate_variance = COASTING[1] * COASTING[1];
            self.grow(imu, period, &turn, None, COASTING.map(|spread| spread * spread * grown));
            return;
        };
        let (rate, force) = (rate - self.gyro_bias, force - self.accelerometer_bias);
        let turn = rate * period;
        let middle = self.rotation * exponential(&(turn * 0.5));
        let acceleration = middle * force + self.gravity;
        self.position += self.velocity * period + acceleration * (0.5 * period * period);
        self.velocity += acceleration * period;
        self.rotation = orthonormal(&(self.rotation * exponential(&turn)));
        self.rate = latest - self.gyro_bias;
        self.rate_variance = imu.gyro_noise * imu.gyro_noise * imu.rate;
        self.coasted = 0.0;
        let noise = [imu.accelerometer_noise, imu.gyro_noise].map(|density| density * density * period);
        self.grow(imu, period, &turn, Some(&force), noise);
    }

    /// Covariance after an interval: transition of the nine errors of the motion, driven by those of the biases by the
    /// specific force where the IMU was read.
    fn grow(&mut self, imu: &Imu, period: f64, turn: &Vector3<f64>, force: Option<&Vector3<f64>>, noise: [f64; 2]) {
        let mut motion = SMatrix::<f64, MOTION, MOTION>::zeros();
        let mut biases = SMatrix::<f64, MOTION, 6>::zeros();
        let mut put = |row: usize, column: usize, block| motion.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
        let half = exponential(&(turn * -0.5));
        let turned = half * half;
        for first in [POSITION, ATTITUDE, VELOCITY] {
            put(first, first, turned);
        }
        put(POSITION, VELOCITY, turned * period);
        if let Some(force) = force {
            let force = turned * half.tr_mul(force).cross_matrix() * -period;
            put(VELOCITY, ATTITUDE, force);
            put(POSITION, ATTITUDE, force * (0.5 * period));
            biases.fixed_view_mut::<3, 3>(ATTITUDE, 0).copy_from(&(half * -period));
            biases.fixed_view_mut::<3, 3>(VELOCITY, 0).copy_from(&(force * (-0.5 * period)));
            biases.fixed_view_mut::<3, 3>(VELOCITY, 3).copy_from(&(half * -period));
            biases.fixed_view_mut::<3, 3>(POSITION, 3).copy_from(&(half * (-0.5 * period * period)));
        }
        let covariance = &mut self.covariance;
        let top: SMatrix<f64, MOTION, STATES> =
            motion * covariance.fixed_rows::<MOTION>(0) + biases * covariance.fixed_rows::<6>(GYRO);
        let corner =
            top.fixed_columns::<MOTION>(0) * motion.transpose() + top.fixed_columns::<6>(GYRO) * biases.transpose();
        covariance.fixed_rows_mut::<MOTION>(0).copy_from(&top);
        covariance.fixed_columns_mut::<MOTION>(0).copy_from(&top.transpose());
        covariance.fixed_view_mut::<MOTION, MOTION>(0, 0).copy_from(&((corner + corner.transpose()) * 0.5));
        for k in 0..3 {
            covariance[(VELOCITY + k, VELOCITY + k)] += noise[0];
            covariance[(ATTITUDE + k, ATTITUDE + k)] += noise[1];
            covariance[(POSITION + k, POSITION + k)] += noise[0] * period * period / 3.0;
            covariance[(GYRO + k, GYRO + k)] += imu.gyro_walk * imu.gyro_walk * period;
            covariance[(ACCELEROMETER + k, ACCELEROMETER + k)] +=
                imu.accelerometer_walk * imu.accelerometer_walk * period;
        }
    }

    /// Stores the place of the transponder, `lever` from the IMU, at a ping.
    pub fn ping(&mut self, time: f64, lever: &Vector3<f64>) {
        self.ping = Some(Ping { time, position: self.position + self.rotation * lever, rotation: self.rotation });
        let turn = -lever.cross_matrix();
        let rows: SMatrix<f64, 3, STATES> =
            self.covariance.fixed_rows::<3>(POSITION) + turn * self.covariance.fixed_rows::<3>(ATTITUDE);
        let corner = rows.fixed_columns::<3>(POSITION) + rows.fixed_columns::<3>(ATTITUDE) * turn.transpose();
        self.covariance.fixed_rows_mut::<3>(PING).copy_from(&rows);
        self.covariance.fixed_columns_mut::<3>(PING).copy_from(&rows.transpose());
        self.covariance.fixed_view_mut::<3, 3>(PING, PING).copy_from(&corner);
    }
}

/// The nearest rotation to one with rounding errors, by a step of Newton's.
fn orthonormal(rotation: &Matrix3<f64>) -> Matrix3<f64> {
    rotation * (Matrix3::identity() * 3.0 - rotation.tr_mul(rotation)) * 0.5
}

//! IMU: specific force and angular velocity, with white noise and biases that walk.

use nalgebra::Vector3;

use super::motion::{Motion, Mount, exponential, rotation_vector};
use super::sensor::{BIASES, Draws, Field, Sensor, Timing, VALUES, each};
use crate::task::settings::settings;

settings! {
    /// Inertial measurement unit. A reading is the mean over the interval since the last sample, from the increments of
    /// velocity and rotation, in the IMU's axes, and the angular velocity at its end.
    pub struct Imu {
        /// Samples per second.
        rate: f64 = 100.0;
        /// Delay, s.
        delay: f64 = 0.0;
        /// Probability that a sample is lost.
        dropout: f64 = 0.0;
        /// Time of failure, s.
        failure: Option<f64> = None;
        /// Position on the vehicle, m.
        position: [f64; 3] = [0.0; 3];
        /// Roll, pitch and yaw of the IMU's axes about the vehicle's, rad.
        rpy: [f64; 3] = [0.0; 3];
        /// Noise density of the angular velocity, rad/s per root Hz: 0.007 deg/s (Xsens MTi-1 data sheet).
        gyro_noise: f64 = 1.2e-4;
        /// Noise density of the specific force, m/s2 per root Hz: 120 micro-g (Xsens MTi-1 data sheet).
        accelerometer_noise: f64 = 1.2e-3;
        /// Standard deviation of the angular velocity's bias at the start, rad/s: typical after warm-up, estimated.
        gyro_bias: f64 = 1e-3;
        /// Standard deviation of the specific force's bias at the start, m/s2: 2 milli-g, typical, estimated.
        accelerometer_bias: f64 = 0.02;
        /// Random walk of the angular velocity's bias, rad/s per root s: in 100 s the 10 deg/h of the data sheet.
        gyro_walk: f64 = 4.8e-6;
        /// Random walk of the specific force's bias, m/s2 per root s: in 100 s the 0.03 milli-g of the data sheet.
        accelerometer_walk: f64 = 3e-5;
    }
}

impl Imu {
    /// Mounting pose.
    pub fn mount(&self) -> Mount {
        Mount::new(self.position, self.rpy)
    }
}

impl Sensor for Imu {
    fn name(&self) -> &'static str {
        "imu"
    }

    fn fields(&self) -> &'static [Field] {
        &[("specific_force", 3), ("angular_velocity", 3), ("latest_angular_velocity", 3)]
    }

    fn timing(&self) -> Timing {
        Timing { rate: self.rate, delay: self.delay, dropout: self.dropout, failure: self.failure }
    }

    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        let mut ranges = vec![
            ("gyro_noise", self.gyro_noise, 0.0, 1.0),
            ("accelerometer_noise", self.accelerometer_noise, 0.0, 10.0),
            ("gyro_bias", self.gyro_bias, 0.0, 1.0),
            ("accelerometer_bias", self.accelerometer_bias, 0.0, 10.0),
            ("gyro_walk", self.gyro_walk, 0.0, 1.0),
            ("accelerometer_walk", self.accelerometer_walk, 0.0, 10.0),
        ];
        ranges.extend(each("position", self.position, 100.0));
        ranges.extend(each("rpy", self.rpy, std::f64::consts::PI));
        ranges
    }

    fn begin(&self, draws: &Draws) -> [f64; BIASES] {
        let deviations = [self.accelerometer_bias, self.gyro_bias];
        std::array::from_fn(|k| deviations[k / 3] * draws.normal(k))
    }

    fn read(
        &self,
        before: Option<&Motion>,
        now: &Motion,
        biases: &mut [f64; BIASES],
        draws: &Draws,
        values: &mut [f64; VALUES],
    ) -> bool {
        let Some(before) = before else { return false };
        let period = now.time - before.time;
        let mount = self.mount();
        let turn = rotation_vector(&(before.rotation.transpose() * now.rotation));
        let velocity = |motion: &Motion| motion.rotation * motion.velocity(&mount.position);
        let acceleration: Vector3<f64> = (velocity(now) - velocity(before)) / period;
        let middle = before.rotation * exponential(&(turn * 0.5));
        let force = mount.rotation.tr_mul(&middle.tr_mul(&(acceleration - now.gravity)));
        let rate = mount.rotation.tr_mul(&(turn / period));
        let walks = [self.accelerometer_walk, self.gyro_walk];
        let noises = [self.accelerometer_noise, self.gyro_noise];
        for k in 0..6 {
            biases[k] += walks[k / 3] * period.sqrt() * draws.normal(6 + k);
            let truth = if k < 3 { force[k] } else { rate[k - 3] };
            values[k] = truth + biases[k] + noises[k / 3] / period.sqrt() * draws.normal(k);
        }
        let latest = mount.rotation.tr_mul(&now.angular);
        for k in 0..3 {
            values[6 + k] = latest[k] + biases[3 + k] + self.gyro_noise * self.rate.sqrt() * draws.normal(12 + k);
        }
        true
    }
}

//! Acoustic position fixes.

use super::motion::Motion;
use super::sensor::{BIASES, Draws, Field, Sensor, Timing, VALUES, each};
use crate::task::settings::settings;

settings! {
    /// Acoustic positioning (USBL, LBL): slow and late fixes in the world, with outliers.
    pub struct Acoustic {
        /// Samples per second: typical of small USBL systems, estimated.
        rate: f64 = 1.0;
        /// Delay, s: travel time, processing and telemetry, estimated.
        delay: f64 = 0.5;
        /// Probability that a fix is lost: typical, estimated.
        dropout: f64 = 0.05;
        /// Time of failure, s.
        failure: Option<f64> = None;
        /// Position of the transponder on the vehicle, m.
        position: [f64; 3] = [0.0; 3];
        /// Standard deviation along the world's x and y axes, m: an angle error of 1 degree at 17 m, estimated.
        noise: f64 = 0.3;
        /// Standard deviation along the world's z axis, m: estimated.
        vertical_noise: f64 = 0.3;
        /// Probability that a fix is an outlier: typical of multipath, estimated.
        outliers: f64 = 0.02;
        /// Standard deviation of the further error of an outlier, m: estimated.
        outlier_noise: f64 = 5.0;
    }
}

impl Sensor for Acoustic {
    fn name(&self) -> &'static str {
        "acoustic"
    }

    fn fields(&self) -> &'static [Field] {
        &[("position", 3)]
    }

    fn timing(&self) -> Timing {
        Timing { rate: self.rate, delay: self.delay, dropout: self.dropout, failure: self.failure }
    }

    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        let mut ranges = vec![
            ("noise", self.noise, 0.0, 1e3),
            ("vertical_noise", self.vertical_noise, 0.0, 1e3),
            ("outliers", self.outliers, 0.0, 1.0),
            ("outlier_noise", self.outlier_noise, 0.0, 1e4),
        ];
        ranges.extend(each("position", self.position, 100.0));
        ranges
    }

    fn begin(&self, _draws: &Draws) -> [f64; BIASES] {
        [0.0; BIASES]
    }

    fn read(
        &self,
        _before: Option<&Motion>,
        now: &Motion,
        _biases: &mut [f64; BIASES],
        draws: &Draws,
        values: &mut [f64; VALUES],
    ) -> bool {
        let outlier = if draws.uniform(1) < self.outliers { self.outlier_noise } else { 0.0 };
        let truth = now.point(&self.position.into());
        let noise = [self.noise, self.noise, self.vertical_noise];
        for k in 0..3 {
            values[k] = truth[k] + noise[k] * draws.normal(k) + outlier * draws.normal(3 + k);
        }
        true
    }
}

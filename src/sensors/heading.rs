//! Heading by a compass.

use nalgebra::Matrix3;

use super::motion::Motion;
use super::sensor::{BIASES, Draws, Field, Sensor, Timing, VALUES};
use crate::task::settings::settings;

/// Minimum length of the horizontal part of the vehicle's x axis.
const HORIZONTAL: f64 = 1e-3;

settings! {
    /// Compass: angle of the vehicle's x axis about the world's z axis, from the world's x axis, with a constant bias.
    pub struct Heading {
        /// Samples per second.
        rate: f64 = 10.0;
        /// Delay, s.
        delay: f64 = 0.0;
        /// Probability that a sample is lost.
        dropout: f64 = 0.0;
        /// Time of failure, s.
        failure: Option<f64> = None;
        /// Standard deviation, rad: typical of magnetometers, estimated.
        noise: f64 = 0.01;
        /// Standard deviation of the bias of an episode, rad: 2 degrees, the static accuracy that makers state, typical.
        bias: f64 = 0.035;
    }
}

/// Heading of a rotation from body to world, rad in (-pi, pi]; None where the x axis is vertical.
pub fn heading(rotation: &Matrix3<f64>) -> Option<f64> {
    let (x, y) = (rotation[(0, 0)], rotation[(1, 0)]);
    (x.hypot(y) > HORIZONTAL).then(|| y.atan2(x))
}

impl Sensor for Heading {
    fn name(&self) -> &'static str {
        "heading"
    }

    fn fields(&self) -> &'static [Field] {
        &[("heading", 1)]
    }

    fn timing(&self) -> Timing {
        Timing { rate: self.rate, delay: self.delay, dropout: self.dropout, failure: self.failure }
    }

    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        vec![("noise", self.noise, 0.0, 3.0), ("bias", self.bias, 0.0, 3.0)]
    }

    fn begin(&self, draws: &Draws) -> [f64; BIASES] {
        [self.bias * draws.normal(0), 0.0, 0.0, 0.0, 0.0, 0.0]
    }

    fn read(
        &self,
        _before: Option<&Motion>,
        now: &Motion,
        biases: &mut [f64; BIASES],
        draws: &Draws,
        values: &mut [f64; VALUES],
    ) -> bool {
        let Some(truth) = heading(&now.rotation) else { return false };
        let (sine, cosine) = (truth + biases[0] + self.noise * draws.normal(0)).sin_cos();
        values[0] = sine.atan2(cosine);
        true
    }
}

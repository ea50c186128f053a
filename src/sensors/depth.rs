//! Depth by pressure.

use super::motion::Motion;
use super::sensor::{BIASES, Draws, Field, Sensor, Timing, VALUES, each};
use crate::task::settings::settings;

settings! {
    /// Pressure sensor: depth below the surface, positive downward, with a constant offset.
    pub struct Depth {
        /// Samples per second.
        rate: f64 = 10.0;
        /// Delay, s.
        delay: f64 = 0.0;
        /// Probability that a sample is lost.
        dropout: f64 = 0.0;
        /// Time of failure, s.
        failure: Option<f64> = None;
        /// Position on the vehicle, m.
        position: [f64; 3] = [0.0; 3];
        /// Standard deviation, m: the resolution of the Blue Robotics Bar30 is 2 mm (maker's page).
        noise: f64 = 0.002;
        /// Standard deviation of the offset of an episode, m: after zeroing at the surface, estimated.
        offset: f64 = 0.02;
        /// Height of the surface in the world, m.
        surface: f64 = 0.0;
    }
}

impl Sensor for Depth {
    fn name(&self) -> &'static str {
        "depth"
    }

    fn fields(&self) -> &'static [Field] {
        &[("depth", 1)]
    }

    fn timing(&self) -> Timing {
        Timing { rate: self.rate, delay: self.delay, dropout: self.dropout, failure: self.failure }
    }

    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        let mut ranges = vec![
            ("noise", self.noise, 0.0, 100.0),
            ("offset", self.offset, 0.0, 100.0),
            ("surface", self.surface, -12e3, 12e3),
        ];
        ranges.extend(each("position", self.position, 100.0));
        ranges
    }

    fn begin(&self, draws: &Draws) -> [f64; BIASES] {
        [self.offset * draws.normal(0), 0.0, 0.0, 0.0, 0.0, 0.0]
    }

    fn read(
        &self,
        _before: Option<&Motion>,
        now: &Motion,
        biases: &mut [f64; BIASES],
        draws: &Draws,
        values: &mut [f64; VALUES],
    ) -> bool {
        values[0] = self.surface - now.point(&self.position.into()).z + biases[0] + self.noise * draws.normal(0);
        true
    }
}

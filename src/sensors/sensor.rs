//! Interface of the sensors.

use super::motion::Motion;
use crate::error::SensorError;
use crate::task::{EpisodeKey, Purpose, Stream};

/// Maximum number of biases of a sensor.
pub const BIASES: usize = 6;
/// Maximum number of values of a reading.
pub const VALUES: usize = 11;
/// First stream of draws: those below belong to tasks and disturbances.
const STREAMS: u32 = 1024;
/// Draws of a sample.
const DRAWS: u32 = 16;

/// Name and length of a part of a reading.
pub type Field = (&'static str, usize);

/// Rate, delay and losses, which all sensors have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// Samples per second.
    pub rate: f64,
    /// Age of a reading when it arrives, s.
    pub delay: f64,
    /// Probability that a sample is lost.
    pub dropout: f64,
    /// Time from which on nothing arrives, s.
    pub failure: Option<f64>,
}

/// Number of the sampling interval that contains a time (s), at a rate (1/s).
pub fn tick(time: f64, rate: f64) -> i64 {
    (time * rate + 1e-6).floor() as i64
}

/// Draws of one sample of a sensor in an episode.
#[derive(Debug, Clone, Copy)]
pub struct Draws {
    noise: Stream,
    loss: Stream,
    sample: u32,
}

impl Draws {
    /// Draws of sample number `sample` of the sensor at place `place` of the list.
    pub(super) fn new(key: EpisodeKey, place: usize, sample: u32) -> Self {
        let stream = |k: u32| Stream::new(key, Purpose::of(STREAMS + 2 * place as u32 + k));
        Self { noise: stream(0), loss: stream(1), sample }
    }

    /// Normal number `k` of the sample, mean 0 and deviation 1.
    pub fn normal(&self, k: usize) -> f64 {
        self.noise.normal(self.sample.wrapping_mul(DRAWS).wrapping_add(k as u32))
    }

    /// Uniform number `k` of the sample, in [0, 1). Number 0 decides on the loss of the sample.
    pub fn uniform(&self, k: usize) -> f64 {
        self.loss.uniform(self.sample.wrapping_mul(DRAWS).wrapping_add(k as u32))
    }
}

/// A sensor: its settings, and readings by them.
pub trait Sensor: Send + Sync {
    /// Name in a suite.
    fn name(&self) -> &'static str;
    /// Parts of a reading.
    fn fields(&self) -> &'static [Field];
    /// Rate, delay and losses.
    fn timing(&self) -> Timing;

    /// Numbers of the settings with their minimum and maximum.
    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)>;

    /// Biases at the start of an episode.
    fn begin(&self, draws: &Draws) -> [f64; BIASES];

    /// Values of the sample at `now`, after the last one at `before`, NaN for lost parts; false where there are none. Biases
    /// that walk advance.
    fn read(
        &self,
        before: Option<&Motion>,
        now: &Motion,
        biases: &mut [f64; BIASES],
        draws: &Draws,
        values: &mut [f64; VALUES],
    ) -> bool;

    /// Refusal of numbers out of range.
    ///
    /// # Errors
    /// [`SensorError::Suite`].
    fn check(&self) -> Result<(), SensorError> {
        let Timing { rate, delay, dropout, failure } = self.timing();
        let common = [
            ("rate", rate, 1e-3, 1e4),
            ("delay", delay, 0.0, 60.0),
            ("dropout", dropout, 0.0, 1.0),
            ("failure", failure.unwrap_or(0.0), 0.0, f64::MAX),
        ];
        for (key, value, minimum, maximum) in common.into_iter().chain(self.ranges()) {
            if !(minimum..=maximum).contains(&value) {
                let key = format!("{}.{key}", self.name());
                let reason = format!("{value} must be within [{minimum}, {maximum}]");
                return Err(SensorError::Suite { key, reason });
            }
        }
        Ok(())
    }
}

/// Ranges of the entries of a vector.
pub(super) fn each(key: &'static str, values: [f64; 3], limit: f64) -> [(&'static str, f64, f64, f64); 3] {
    values.map(|value| (key, value, -limit, limit))
}

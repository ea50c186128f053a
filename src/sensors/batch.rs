//! Sensors of a batch of instances.

use std::collections::VecDeque;

use super::motion::Motion;
use super::sensor::{BIASES, Draws, Field, Sensor, Timing, VALUES, tick};
use super::suite::Suite;
use crate::error::SensorError;
use crate::task::EpisodeKey;

/// Tolerance of arrival times, s.
const ROUNDING: f64 = 1e-9;

/// A sample on its way.
#[derive(Debug, Clone, Copy)]
struct Sample {
    arrival: f64,
    time: f64,
    values: [f64; VALUES],
}

/// State of one sensor of an instance.
#[derive(Debug, Clone, Default)]
struct Channel {
    tick: Option<i64>,
    samples: u32,
    biases: [f64; BIASES],
    failed: bool,
    last: Option<Motion>,
    pending: VecDeque<Sample>,
}

/// Readings of one sensor that arrived at a call, by instance.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorReadings {
    /// Name of the sensor.
    pub name: &'static str,
    /// Parts of a reading.
    pub fields: &'static [Field],
    /// Numbers of a reading.
    pub width: usize,
    /// True where a reading arrived, (N,).
    pub valid: Vec<bool>,
    /// Time of the sample, s, NaN without one, (N,).
    pub time: Vec<f64>,
    /// Values by rows, NaN where lost, (N, width).
    pub values: Vec<f64>,
}

/// Readings of all sensors at a call.
#[derive(Debug, Clone, PartialEq)]
pub struct Readings {
    /// Time of the call, s, (N,).
    pub time: Vec<f64>,
    /// Readings of each sensor.
    pub sensors: Vec<SensorReadings>,
}

/// Sensors of instances. Readings of an instance depend only on its motion, its seed and the times of the calls.
pub struct Sensors {
    suite: Suite,
    sensors: Vec<Box<dyn Sensor>>,
    keys: Vec<EpisodeKey>,
    /// By instance, then sensor.
    channels: Vec<Vec<Channel>>,
    /// Time of the last call.
    times: Vec<Option<f64>>,
}

impl Sensors {
    /// Sensors of as many instances; instance i draws as a single one with the seed `seed + i`.
    pub fn new(suite: Suite, instances: usize, seed: u64) -> Self {
        let sensors = suite.sensors();
        let keys = (0..instances).map(|i| EpisodeKey { seed: seed.wrapping_add(i as u64), episode: 0 }).collect();
        let channels = vec![vec![Channel::default(); sensors.len()]; instances];
        let mut all = Self { suite, sensors, keys, channels, times: vec![None; instances] };
        (0..instances).for_each(|i| all.begin(i));
        all
    }

    /// Settings.
    pub fn suite(&self) -> &Suite {
        &self.suite
    }

    /// Number of instances.
    pub fn instances(&self) -> usize {
        self.keys.len()
    }

    /// New episode of instance `i`: new biases, no samples on their way. With a seed the first episode of that seed.
    pub fn reset(&mut self, i: usize, seed: Option<u64>) {
        self.keys[i] = seed.map_or(self.keys[i].following(), |seed| EpisodeKey { seed, episode: 0 });
        self.begin(i);
    }

    fn begin(&mut self, i: usize) {
        self.times[i] = None;
        for (sensor, channel) in self.sensors.iter().zip(&mut self.channels[i]) {
            let draws = Draws::new(self.keys[i], Suite::place(sensor.name()), 0);
            *channel = Channel { biases: sensor.begin(&draws), samples: 1, ..Channel::default() };
        }
    }

    /// Failure of a sensor of instance `i`, or its end.
    ///
    /// # Errors
    /// [`SensorError::Unknown`].
    pub fn fail(&mut self, i: usize, name: &str, failed: bool) -> Result<(), SensorError> {
        let Some(k) = self.sensors.iter().position(|sensor| sensor.name() == name) else {
            let known = self.sensors.iter().map(|sensor| sensor.name()).collect();
            return Err(SensorError::Unknown { name: name.into(), known });
        };
        self.channels[i][k].failed = failed;
        Ok(())
    }

    /// Biases of a sensor of instance `i` now: a number for each bias, 0 for absent ones.
    pub fn biases(&self, i: usize, name: &str) -> Option<[f64; BIASES]> {
        let k = self.sensors.iter().position(|sensor| sensor.name() == name)?;
        Some(self.channels[i][k].biases)
    }

    /// Samples of the motions now, one for each instance, and the readings that have arrived.
    ///
    /// A sensor samples at the first call in each of its intervals of `1 / rate`. Of several readings that arrive between
    /// two calls the last one counts.
    ///
    /// # Errors
    /// [`SensorError::Instances`], and [`SensorError::Time`] where a time is before that of the last call; nothing has
    /// changed then.
    pub fn measure(&mut self, motions: &[Motion]) -> Result<Readings, SensorError> {
        let instances = self.instances();
        if motions.len() != instances {
            return Err(SensorError::Instances { expected: instances, got: motions.len() });
        }
        for (instance, motion) in motions.iter().enumerate() {
            if let Some(before) = self.times[instance]
                && motion.time < before
            {
                return Err(SensorError::Time { instance, time: motion.time, before });
            }
        }
        let mut readings = Readings { time: motions.iter().map(|motion| motion.time).collect(), sensors: Vec::new() };
        for (k, sensor) in self.sensors.iter().enumerate() {
            let width = sensor.fields().iter().map(|field| field.1).sum();
            let mut found = SensorReadings {
                name: sensor.name(),
                fields: sensor.fields(),
                width,
                valid: vec![false; instances],
                time: vec![f64::NAN; instances],
                values: vec![f64::NAN; instances * width],
            };
            for (i, motion) in motions.iter().enumerate() {
                let channel = &mut self.channels[i][k];
                channel.sample(sensor.as_ref(), self.keys[i], motion);
                if let Some(sample) = channel.arrived(motion.time) {
                    found.valid[i] = true;
                    found.time[i] = sample.time;
                    found.values[i * width..(i + 1) * width].copy_from_slice(&sample.values[..width]);
                }
            }
            readings.sensors.push(found);
        }
        self.times = motions.iter().map(|motion| Some(motion.time)).collect();
        Ok(readings)
    }
}

impl Channel {
    /// Takes a sample where one is due.
    fn sample(&mut self, sensor: &dyn Sensor, key: EpisodeKey, motion: &Motion) {
        let Timing { rate, delay, dropout, failure } = sensor.timing();
        let now = tick(motion.time, rate);
        let repeated = self.last.is_some_and(|last| last.time >= motion.time);
        if self.tick.is_some_and(|last| now <= last) || repeated {
            return;
        }
        let draws = Draws::new(key, Suite::place(sensor.name()), self.samples);
        let mut values = [f64::NAN; VALUES];
        let read = sensor.read(self.last.as_ref(), motion, &mut self.biases, &draws, &mut values);
        self.tick = Some(now);
        self.samples = self.samples.wrapping_add(1);
        self.last = Some(*motion);
        let failed = self.failed || failure.is_some_and(|from| motion.time >= from);
        if read && !failed && draws.uniform(0) >= dropout {
            self.pending.push_back(Sample { arrival: motion.time + delay, time: motion.time, values });
        }
    }

    /// The last reading that has arrived by a time.
    fn arrived(&mut self, time: f64) -> Option<Sample> {
        let mut last = None;
        while let Some(sample) = self.pending.front()
            && sample.arrival <= time + ROUNDING
        {
            last = self.pending.pop_front();
        }
        last
    }
}

//! The filter of a batch of instances.

use nalgebra::Vector3;

use super::correction::Innovation;
use super::estimate::Estimate;
use super::state::{FilterState, Start};
use crate::error::SensorError;
use crate::sensors::{BEAMS, Imu, Mount, Suite, tick};

/// Sensors whose readings correct the estimate.
pub const UPDATES: [&str; 4] = ["dvl", "depth", "heading", "acoustic"];

/// Intervals of the IMU after which a reading is missing.
const MISSING: f64 = 1.5;

/// Readings of an instance; absent ones did not arrive.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct InstanceReadings {
    /// Time of the sample, its mean specific force and angular velocity, and its latest angular velocity, in the IMU's
    /// axes.
    pub imu: Option<(f64, [Vector3<f64>; 3])>,
    /// Velocities along the beams, NaN where lost.
    pub dvl: Option<[f64; BEAMS]>,
    /// Depth, m.
    pub depth: Option<f64>,
    /// Heading, rad.
    pub heading: Option<f64>,
    /// Time of the ping and the position.
    pub acoustic: Option<(f64, Vector3<f64>)>,
}

/// Navigation filters of instances with the same sensors.
#[derive(Debug, Clone)]
pub struct NavigationFilter {
    suite: Suite,
    imu: Imu,
    mount: Mount,
    states: Vec<Option<FilterState>>,
    /// Innovations of the last update, in the order of [`UPDATES`].
    innovations: Vec<[Option<Innovation>; UPDATES.len()]>,
}

impl NavigationFilter {
    /// Filters for sensors with these settings.
    ///
    /// # Errors
    /// [`SensorError::Suite`] without an IMU, for late sensors other than the acoustic one, and for fixes that are
    /// older than the interval between them.
    pub fn new(suite: Suite, instances: usize) -> Result<Self, SensorError> {
        let refuse = |key: &str, reason: String| Err(SensorError::Suite { key: key.into(), reason });
        let Some(imu) = suite.imu.clone() else {
            return refuse("imu", "the navigation filter needs an IMU".into());
        };
        for sensor in suite.sensors() {
            let (name, timing) = (sensor.name(), sensor.timing());
            let limit = if name == "acoustic" { 1.0 / timing.rate } else { 0.0 };
            if timing.delay > limit {
                let reason = format!("{} s, but the navigation filter bridges at most {limit} s", timing.delay);
                return refuse(&format!("{name}.delay"), reason);
            }
        }
        let mount = imu.mount();
        let innovations = vec![[None; UPDATES.len()]; instances];
        Ok(Self { suite, imu, mount, states: vec![None; instances], innovations })
    }

    /// Settings of the sensors.
    pub fn suite(&self) -> &Suite {
        &self.suite
    }

    /// Number of instances.
    pub fn instances(&self) -> usize {
        self.states.len()
    }

    /// Start of instance `i`.
    pub fn reset(&mut self, i: usize, start: &Start) {
        self.states[i] = Some(FilterState::new(start, &self.suite, &self.mount.position));
        self.innovations[i] = [None; UPDATES.len()];
    }

    /// Update of instance `i` to a time by the readings that have arrived.
    ///
    /// # Errors
    /// [`SensorError::NotBegun`] before [`Self::reset`], [`SensorError::Time`] where time runs backward.
    pub fn update(&mut self, i: usize, time: f64, readings: &InstanceReadings) -> Result<(), SensorError> {
        let Some(state) = &mut self.states[i] else { return Err(SensorError::NotBegun { instance: i }) };
        let before = state.called.unwrap_or(state.time);
        if time.is_nan() || time < before {
            return Err(SensorError::Time { instance: i, time, before });
        }
        let imu = &self.mount.position;
        let finite = |values: &[Vector3<f64>; 3]| values.iter().flatten().all(|x| x.is_finite());
        match readings.imu.filter(|(_, values)| finite(values)) {
            Some((sampled, values)) => {
                state.propagate(&self.imu, sampled, Some(values.map(|value| self.mount.rotation * value)));
            }
            None if time - state.time > MISSING / self.imu.rate => state.propagate(&self.imu, time, None),
            None => {}
        }
        let mut found = [None; UPDATES.len()];
        if let Some(acoustic) = &self.suite.acoustic {
            // A fix of the last ping comes before the next ping, which replaces it.
            let late = readings.acoustic.filter(|(sampled, _)| *sampled < time);
            found[3] = late.and_then(|(sampled, fix)| state.by_fix(acoustic, sampled, &fix));
            let now = tick(time, acoustic.rate);
            if state.called.is_none_or(|last| tick(last, acoustic.rate) < now) {
                state.ping(time, &(Vector3::from(acoustic.position) - imu));
            }
            if let Some((sampled, fix)) = readings.acoustic
                && late.is_none()
            {
                found[3] = state.by_fix(acoustic, sampled, &fix);
            }
        }
        state.called = Some(time);
        if let (Some(dvl), Some(beams)) = (&self.suite.dvl, &readings.dvl) {
            found[0] = state.by_beams(dvl, imu, beams);
        }
        if let (Some(depth), Some(reading)) = (&self.suite.depth, readings.depth) {
            found[1] = state.by_depth(depth, imu, reading);
        }
        if let (Some(compass), Some(reading)) = (&self.suite.heading, readings.heading) {
            found[2] = state.by_heading(compass, reading);
        }
        self.innovations[i] = found;
        Ok(())
    }

    /// Estimate of instance `i`.
    ///
    /// # Errors
    /// [`SensorError::NotBegun`].
    pub fn estimate(&self, i: usize) -> Result<Estimate, SensorError> {
        match &self.states[i] {
            Some(state) => Ok(state.estimate(&self.mount.position)),
            None => Err(SensorError::NotBegun { instance: i }),
        }
    }

    /// Innovations of the last update of instance `i`, in the order of [`UPDATES`]; None where no reading corrected.
    pub fn innovations(&self, i: usize) -> &[Option<Innovation>; UPDATES.len()] {
        &self.innovations[i]
    }
}

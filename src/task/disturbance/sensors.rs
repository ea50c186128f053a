//! Sensors: noise, bias and delay of measurements.

use super::column::Column;
use super::component::{Component, QUAD, component, normal_pair};
use super::components::Places;
use super::context::DisturbanceContext;
use super::span::{Span, refuse};
use crate::control::MAX_SENSOR_DELAY;
use crate::error::TaskError;
use crate::lane::{Lane, Real, Routine, Rows};
use crate::system::JOINTS;
use crate::task::random::Stream;

/// Measured numbers of a vehicle without joints: errors of position and attitude, twist.
pub const MEASURED_OF_VEHICLE: usize = 12;
/// Maximum count of measured numbers: those, then joint coordinates, joint rates, and the direction against gravity; the last
/// one is the age of a held measurement, control periods.
pub const MEASURED: usize = MEASURED_OF_VEHICLE + 2 * JOINTS + 4;

component! {
    /// White noise of the measurements, with these standard deviations at every control instant.
    pub struct Noise = "noise" {
        /// Position error, m.
        position: f64 = 0.005, in 0.0, 1.0;
        /// Attitude error, rad.
        attitude: f64 = 0.005, in 0.0, 1.0;
        /// Linear velocity, m/s.
        linear_velocity: f64 = 0.01, in 0.0, 1.0;
        /// Angular velocity, rad/s.
        angular_velocity: f64 = 0.01, in 0.0, 1.0;
        /// Joint coordinates, rad or m.
        joint_position: f64 = 0.002, in 0.0, 1.0;
        /// Joint rates, rad/s or m/s.
        joint_rate: f64 = 0.01, in 0.0, 1.0;
        /// Bias throughout an episode: its standard deviation relative to the noise's.
        bias: f64 = 0.0, in 0.0, 10.0;
    }
}

impl Component for Noise {
    /// Stream of the noise.
    const STREAM: u32 = 41;
}

impl Noise {
    /// Stream of the biases.
    pub(super) const BIAS: u32 = 39;

    /// Deviation of each measured number.
    fn deviations(&self, joints: usize) -> Vec<f64> {
        let vehicle = [self.position, self.attitude, self.linear_velocity, self.angular_velocity];
        let vehicle = vehicle.into_iter().flat_map(|deviation| [deviation; 3]);
        let joint = |deviation| std::iter::repeat_n(deviation, joints);
        let tilt = std::iter::repeat_n(self.attitude, 3);
        vehicle.chain(joint(self.joint_position)).chain(joint(self.joint_rate)).chain(tilt).collect()
    }
}

component! {
    /// Age of the measurements when observed, the same throughout an episode.
    pub struct Delay = "delay" {
        /// Age in seconds, drawn per episode and rounded to control periods.
        time: Span = Span::of(0.0, 0.0), in 0.0, 1e3;
        /// Further age in control periods.
        periods: u32 = 0;
    }
}

impl Component for Delay {
    const STREAM: u32 = 43;
    const RESERVED: bool = false;

    fn check(&self, context: &DisturbanceContext) -> Result<(), TaskError> {
        let periods = self.time.high / context.period + f64::from(self.periods);
        if periods > MAX_SENSOR_DELAY as f64 {
            return refuse("delay", format!("{periods:.0} control periods, but at most {MAX_SENSOR_DELAY} are taken"));
        }
        Ok(())
    }
}

impl Delay {
    /// Age in control periods at a share in [0, 1) of its range.
    pub(in crate::task) fn in_periods(&self, period: f64, share: f64) -> usize {
        (self.time.at(share) / period).round() as usize + self.periods as usize
    }

    /// Minimum and maximum age in control periods.
    pub(super) fn range(&self, period: f64) -> [usize; 2] {
        [0.0, 1.0].map(|share| self.in_periods(period, share))
    }
}

/// Rows of the sensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SensorRows {
    /// Count of measured numbers.
    pub measured: usize,
    /// With noise: first row of the standard deviations, then biases; first row of the uniform draws for the noise.
    pub noise: Option<[usize; 2]>,
    /// Measurements now, a period ago, and so on.
    pub ring: usize,
    /// Number of stored measurements.
    pub slots: usize,
    /// Row of the delay, control periods, where it is drawn; else all measurements are as old as the oldest.
    pub age: Option<usize>,
    /// Row of the reading's age, control periods, where measurements may be held; their ages follow them in the ring.
    pub held: Option<usize>,
}

impl SensorRows {
    /// Uniform draws of one control instant.
    pub(super) fn draws(measured: usize) -> usize {
        measured.next_multiple_of(QUAD)
    }

    /// Sets the deviations and draws the biases.
    pub(super) fn begin<T: Real>(
        &self,
        noise: Option<&Noise>,
        memory: &mut Column<'_, T>,
        draw: &Stream,
        joints: usize,
    ) {
        let Some([row, _]) = self.noise else { return };
        let mut deviations = noise.map_or(vec![0.0; self.measured], |noise| noise.deviations(joints));
        deviations.truncate(self.measured);
        let share = noise.map_or(0.0, |noise| noise.bias);
        memory.set_all(row, deviations.iter().copied());
        let bias = deviations.iter().enumerate().map(|(k, deviation)| share * deviation * draw.normal(k as u32));
        memory.set_all(row + self.measured, bias);
    }

    /// Stores a measurement of true values: errors of position and attitude, twist, joint coordinates, joint rates.
    #[inline(always)]
    pub(super) fn measure<L: Lane>(&self, memory: &mut Rows<'_, L::Real>, places: &Places, truth: &[L; MEASURED]) {
        L::call(&mut Measurement { sensors: self, memory, places, truth });
    }

    /// Numbers of a stored measurement.
    #[inline(always)]
    fn width(&self) -> usize {
        if self.held.is_some() { self.measured + 1 } else { self.measured }
    }

    /// Place of a stored number in a measurement.
    #[inline(always)]
    fn place(&self, k: usize) -> usize {
        if k < self.measured { k } else { MEASURED - 1 }
    }

    #[inline(always)]
    fn store<L: Lane>(&self, memory: &mut Rows<'_, L::Real>, places: &Places, truth: &[L; MEASURED]) {
        let (width, measured) = (self.width(), self.measured);
        for slot in (1..self.slots).rev() {
            for k in 0..width {
                let row = self.ring + slot * width + k;
                let last: L = memory.get(row - width);
                memory.set(row, last);
            }
        }
        let mut seen = *truth;
        if let Some([row, draws]) = self.noise {
            let mut k = 0;
            while k < measured {
                let pair: [L; 2] = normal_pair(memory.get_all(draws + k));
                for j in 0..2 {
                    if k + j < measured {
                        let deviation: L = memory.get(row + k + j);
                        let bias: L = memory.get(row + measured + k + j);
                        seen[k + j] = pair[j].mul_add(deviation, seen[k + j] + bias);
                    }
                }
                k += 2;
            }
        }
        if places.measures() {
            let mut last = [L::zero(); MEASURED];
            for k in 0..width {
                last[self.place(k)] = memory.get(self.ring + k);
            }
            places.measure(memory, &last, &mut seen);
        }
        for k in 0..width {
            memory.set(self.ring + k, seen[self.place(k)]);
        }
        if let Some(row) = self.held {
            let delay: L = match self.age {
                Some(row) => memory.get(row),
                None => L::c((self.slots - 1) as f64),
            };
            memory.set(row, self.reading::<L>(memory)[MEASURED - 1] + delay);
        }
    }

    /// Fills the older measurements with the first one.
    pub fn fill<T: Real>(&self, memory: &mut Column<'_, T>) {
        let width = self.width();
        for row in self.ring + width..self.ring + self.slots * width {
            let first = memory.get(row - width);
            memory.set(row, first);
        }
    }

    /// Reading now: entries in the order of [`Self::measure`], zeros past the last.
    #[inline(always)]
    pub fn reading<L: Lane>(&self, memory: &Rows<'_, L::Real>) -> [L; MEASURED] {
        let (mut seen, width) = ([L::zero(); MEASURED], self.width());
        for k in 0..width {
            seen[self.place(k)] = memory.get(self.ring + (self.slots - 1) * width + k);
        }
        if let Some(row) = self.age {
            let age: L = memory.get(row);
            for slot in (0..self.slots - 1).rev() {
                let younger = age.lt(L::c(slot as f64 + 0.5));
                for k in 0..width {
                    let entry: L = memory.get(self.ring + slot * width + k);
                    seen[self.place(k)] = L::select(younger, entry, seen[self.place(k)]);
                }
            }
        }
        seen
    }
}

/// [`SensorRows::measure`], which the kernels of all tasks share.
struct Measurement<'a, 'b, L: Lane> {
    sensors: &'a SensorRows,
    memory: &'a mut Rows<'b, L::Real>,
    places: &'a Places,
    truth: &'a [L; MEASURED],
}

impl<L: Lane> Routine<L> for Measurement<'_, '_, L> {
    const PORTABLE: bool = true;

    #[inline(always)]
    fn run(&mut self) {
        self.sensors.store(self.memory, self.places, self.truth);
    }
}

//! Rows of the disturbances in an episode's memory, and their kernel for a group of instances.

use nalgebra::Vector3 as Vector;

use super::column::Column;
use super::component::{Component, Forcing, Moment, QUAD};
use super::components::{Disturbance, Places};
use super::context::DisturbanceContext;
use super::payload::{Payload, PayloadEvent};
use super::sensors::{Delay, MEASURED, MEASURED_OF_VEHICLE, Noise, SensorRows};
use super::waves::{WaveOrbit, Waves};
use crate::lane::{Lane, Real, Routine, Rows};
use crate::lie::{Pose, Vector3, Vector6};
use crate::task::EpisodeKey;
use crate::task::random::{Purpose, Stream};

/// Rows of the present components.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DisturbanceRows {
    /// Completed control periods.
    pub clock: usize,
    /// Steady current in world axes, 3.
    pub steady: usize,
    /// Rows of [`Forcing::summary`], 3.
    pub summary: usize,
    /// Rows of each component.
    pub places: Places,
    /// Age of the reading, control periods, where measurements are late or held.
    pub age: Option<usize>,
    /// Row past the recorded ones, of which the last is the age.
    pub recorded: usize,
    /// Sensors with noise or delay.
    pub sensors: Option<SensorRows>,
    /// Row past the last.
    pub end: usize,
}

impl DisturbanceRows {
    /// Rows from `start` on; `None` if nothing changes within an episode.
    pub fn new(disturbance: &Disturbance, context: &DisturbanceContext, start: usize) -> Option<Self> {
        let mut end = start;
        let mut take = |count: usize| {
            end += count;
            end - count
        };
        let measured = MEASURED_OF_VEHICLE + 2 * context.joints + if context.tilt { 3 } else { 0 };
        let [minimum, periods] = disturbance.delay_range(context.period);
        let (drawn, holds) = (minimum < periods, disturbance.dropout.is_some());
        let mut rows = Self {
            clock: take(1),
            steady: take(3),
            summary: take(3),
            places: Places::new(disturbance, context, &mut take),
            age: (periods > 0 || holds).then(|| take(1)),
            recorded: take(0),
            sensors: None,
            end: 0,
        };
        rows.sensors = (disturbance.noise.is_some() || periods > 0 || rows.places.measures()).then(|| SensorRows {
            measured,
            noise: disturbance.noise.as_ref().map(|_| [take(2 * measured), take(SensorRows::draws(measured))]),
            ring: take((1 + periods) * (measured + usize::from(holds))),
            slots: 1 + periods,
            age: if drawn && holds { Some(take(1)) } else { rows.age.filter(|_| drawn) },
            held: rows.age.filter(|_| holds),
        });
        rows.end = end;
        (rows.places.any() || rows.sensors.is_some()).then_some(rows)
    }
}

/// Disturbances that change within episodes, for instances with the same rows.
#[derive(Debug, Clone, PartialEq)]
pub struct DisturbanceKernel<T> {
    rows: DisturbanceRows,
    context: DisturbanceContext,
    /// Level axes in world axes: two horizontal ones and the one against gravity.
    level: [Vector3<T>; 3],
    /// Control periods per second.
    frequency: T,
}

/// Draws reserved for the noise of a control instant.
const NOISE: u32 = 16;

impl<T: Real> DisturbanceKernel<T> {
    /// Kernel in the precision of the lanes.
    pub fn new(rows: DisturbanceRows, context: &DisturbanceContext) -> Self {
        let level = context.level.map(|axis| Vector3(axis.map(T::from_f64).into()));
        Self { rows, level, frequency: T::from_f64(1.0 / context.period), context: context.clone() }
    }

    /// Rows of the disturbances' memory.
    pub fn rows(&self) -> &DisturbanceRows {
        &self.rows
    }

    /// Rows of the sensors; none without noise and delay.
    #[inline(always)]
    pub fn sensors(&self) -> Option<&SensorRows> {
        self.rows.sensors.as_ref()
    }

    /// Stores a measurement of true values, where there are rows for it: see [`super::Component::measure`].
    #[inline(always)]
    pub fn measure<L: Lane<Real = T>>(&self, memory: &mut Rows<'_, T>, truth: &[L; MEASURED]) {
        if let Some(sensors) = &self.rows.sensors {
            sensors.measure(memory, &self.rows.places, truth);
        }
    }

    /// Rows of the components.
    #[inline(always)]
    pub fn places(&self) -> &Places {
        &self.rows.places
    }

    /// Draws an episode of `disturbance`, which has no more components than the rows.
    pub fn begin(&self, memory: &mut Column<'_, T>, key: EpisodeKey, steady: &Vector<f64>, disturbance: &Disturbance) {
        let (rows, context) = (&self.rows, &self.context);
        (rows.clock..rows.end).for_each(|row| memory.set(row, 0.0));
        memory.set_all(rows.steady, steady.iter().copied());
        rows.places.begin(disturbance, memory, key, context);
        if let Some(sensors) = &rows.sensors {
            let draw = Stream::new(key, Purpose::of(Noise::BIAS));
            sensors.begin(disturbance.noise.as_ref(), memory, &draw, context.joints);
            if let (Some(row), Some(delay)) = (rows.age, &disturbance.delay) {
                let share = Stream::new(key, Purpose::of(Delay::STREAM)).uniform(0);
                let age = delay.in_periods(context.period, share) as f64;
                memory.set(row, age);
                sensors.age.iter().for_each(|row| memory.set(*row, age));
            }
            self.sample_sensors(memory, key, 0);
        }
    }

    /// Advances one instance before control period `step`: draws, and the next event after one that is over.
    pub fn advance(&self, memory: &mut Column<'_, T>, key: EpisodeKey, step: u32) {
        self.rows.places.renew(memory, key, step, &self.context);
        self.sample_sensors(memory, key, step.wrapping_add(1));
    }

    fn sample_sensors(&self, memory: &mut Column<'_, T>, key: EpisodeKey, instant: u32) {
        let Some(SensorRows { measured, noise: Some([_, draws]), .. }) = self.rows.sensors else { return };
        let stream = Stream::new(key, Purpose::of(Noise::STREAM));
        for k in 0..measured.div_ceil(QUAD) {
            memory.set_all(draws + QUAD * k, stream.quad(instant.wrapping_mul(NOISE).wrapping_add(k as u32)));
        }
    }

    /// Event of the payload before control period `step`.
    pub fn payload_event(&self, memory: &Column<'_, T>, step: u32) -> Option<PayloadEvent> {
        Payload::event(memory.get_all(self.rows.places.payload?.row), f64::from(step))
    }

    /// Sets the payload carried from now on, kg.
    pub fn hold(&self, memory: &mut Column<'_, T>, carried: f64) {
        if let Some(at) = self.rows.places.payload {
            memory.set(at.row + Payload::ROWS - 1, carried);
        }
    }

    /// Forcing over the coming control period.
    #[inline(always)]
    pub fn forcing<L: Lane<Real = T>>(&self, memory: &Rows<'_, T>, pose: &Pose<L>, twist: &Vector6<L>) -> Forcing<L> {
        let (level, frequency) = (&[self.axis(0), self.axis(1), self.axis(2)], L::splat(self.frequency));
        let (now, thrusters) = (memory.get(self.rows.clock), self.context.thrusters);
        let mut forcing = Forcing { velocity: Vector3(memory.get_all(self.rows.steady)), ..Forcing::none() };
        self.rows.places.add(memory, &Moment { now, pose, twist, level, frequency, thrusters }, &mut forcing);
        forcing
    }

    /// Forcing over the coming control period, recorded in the memory; then the memory at the period's end. `current` is
    /// the row of the current.
    #[inline(always)]
    pub fn pass_period<L: Lane<Real = T>>(
        &self,
        memory: &mut Rows<'_, T>,
        pose: &Pose<L>,
        twist: &Vector6<L>,
        current: usize,
        forcing: &mut Forcing<L>,
    ) {
        L::call(&mut Period { kernel: self, memory, pose, twist, current, forcing });
    }

    /// Records the current and the disturbance's metrics; `current` is the row of the current.
    #[inline(always)]
    pub fn record<L: Lane<Real = T>>(&self, memory: &mut Rows<'_, T>, current: usize, forcing: &Forcing<L>) {
        memory.set_all(current, &forcing.velocity.0);
        memory.set_all(self.rows.summary, &forcing.summary());
    }

    /// Advances clock and phases to the end of the control period.
    #[inline(always)]
    pub fn end_period<L: Lane<Real = T>>(&self, memory: &mut Rows<'_, T>) {
        let rows = &self.rows;
        let now: L = memory.get(rows.clock);
        memory.set(rows.clock, now + L::c(1.0));
        rows.places.end_period::<L>(memory);
    }

    /// Orbital motion of the water around `place` (world axes, m) at the control instant; none without waves.
    #[inline(always)]
    pub fn wave_orbit<L: Lane<Real = T>>(&self, memory: &Rows<'_, T>, place: Vector3<L>) -> WaveOrbit<L> {
        match self.rows.places.waves {
            Some(at) => Waves::orbit(memory, at, place, self.axis(2), L::splat(self.frequency)),
            None => WaveOrbit::zero(),
        }
    }

    #[inline(always)]
    fn axis<L: Lane<Real = T>>(&self, k: usize) -> Vector3<L> {
        let [x, y, z] = self.level[k].0;
        Vector3([L::splat(x), L::splat(y), L::splat(z)])
    }
}

/// [`DisturbanceKernel::pass_period`], which the kernels of all tasks share.
struct Period<'a, 'b, L: Lane> {
    kernel: &'a DisturbanceKernel<L::Real>,
    memory: &'a mut Rows<'b, L::Real>,
    pose: &'a Pose<L>,
    twist: &'a Vector6<L>,
    current: usize,
    forcing: &'a mut Forcing<L>,
}

impl<L: Lane> Routine<L> for Period<'_, '_, L> {
    #[inline(always)]
    fn run(&mut self) {
        let Self { kernel, memory, pose, twist, current, forcing } = self;
        **forcing = kernel.forcing(memory, pose, twist);
        kernel.record(memory, *current, forcing);
        kernel.end_period::<L>(memory);
    }
}

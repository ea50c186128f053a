//! Kernel of all disturbances for a group of instances.

use nalgebra::Vector3 as Vector;

use super::column::Column;
use super::context::DisturbanceContext;
use super::current::{Drift, Gust};
use super::draws::{QUAD, normal_pair};
use super::impulse::Impulse;
use super::payload::{Payload, PayloadEvent};
use super::rows::DisturbanceRows;
use super::script::Script;
use super::tether::Tether;
use super::thrusters::ThrusterLoss;
use super::waves::{WaveOrbit, Waves};
use super::{Disturbance, SensorRows};
use crate::control::THRUSTERS;
use crate::lane::{Lane, Real, Routine, Rows};
use crate::lie::{Pose, Vector3, Vector6};
use crate::task::EpisodeKey;
use crate::task::random::{Purpose, Stream};

/// Forcing by all disturbances over one control period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Forcing<L> {
    /// Velocity of the water at the start of the period, world axes, m/s.
    pub velocity: Vector3<L>,
    /// Acceleration of the water by waves, m/s^2; the other currents are quasi-steady.
    pub acceleration: Vector3<L>,
    /// Wrench on the vehicle, body axes at its origin, N and N m.
    pub wrench: Vector6<L>,
    /// Remaining gain of each thruster; 1 past the last.
    pub gains: [L; THRUSTERS],
    /// Payload, kg.
    pub payload: L,
}

impl<L: Lane> Forcing<L> {
    /// No forcing.
    #[inline(always)]
    pub fn none() -> Self {
        let (velocity, acceleration) = (Vector3::zero(), Vector3::zero());
        Self { velocity, acceleration, wrench: Vector6::zero(), gains: [L::c(1.0); THRUSTERS], payload: L::zero() }
    }

    /// Summary for `info`: magnitude of the force (N), payload (kg), minimum gain of a thruster.
    #[inline(always)]
    pub fn summary(&self) -> [L; 3] {
        let force = self.wrench.linear;
        let mut minimum = self.gains[0];
        for k in 1..THRUSTERS {
            minimum = self.gains[k].min(minimum);
        }
        [force.dot(force).sqrt(), self.payload, minimum]
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

/// Draws reserved at the start of a stream; those of control periods follow.
const FIRST: u32 = 16;
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

    /// True where the water's velocity changes within an episode.
    #[inline(always)]
    pub fn flows(&self) -> bool {
        self.rows.flows()
    }

    /// True where the water accelerates.
    #[inline(always)]
    pub fn accelerates(&self) -> bool {
        self.rows.waves.is_some()
    }

    /// True where there is an external force.
    #[inline(always)]
    pub fn pushes(&self) -> bool {
        self.rows.pushes()
    }

    /// True where thrusters lose thrust.
    #[inline(always)]
    pub fn weakens(&self) -> bool {
        self.rows.thrusters.is_some()
    }

    /// Draws an episode of `disturbance`, which has no more components than the rows.
    pub fn begin(&self, memory: &mut Column<'_, T>, key: EpisodeKey, steady: &Vector<f64>, disturbance: &Disturbance) {
        let (rows, context) = (&self.rows, &self.context);
        let stream = |purpose| Stream::new(key, purpose);
        (rows.clock..rows.end).for_each(|row| memory.set(row, 0.0));
        memory.set_all(rows.steady, steady.iter().copied());
        if let (Some([row, _]), Some(drift)) = (rows.drift, &disturbance.drift) {
            memory.set_all(row, drift.draw(&stream(Purpose::Drift), context));
        }
        if let (Some(row), Some(gust)) = (rows.gust, &disturbance.gust) {
            gust.begin(memory, row, &Gust::stream(key), context);
        }
        if let (Some([row, trains]), Some(waves)) = (rows.waves, &disturbance.waves) {
            waves.begin(memory, row, trains, &stream(Purpose::Waves), context);
        }
        if let (Some(row), Some(impulse)) = (rows.impulse, &disturbance.impulse) {
            impulse.begin(memory, row, &Impulse::stream(key), context);
        }
        if let (Some(row), Some(tether)) = (rows.tether, &disturbance.tether) {
            memory.set_all(row, tether.draw(&stream(Purpose::Tether), context));
        }
        if let (Some(row), Some(payload)) = (rows.payload, &disturbance.payload) {
            memory.set_all(row, payload.draw(&stream(Purpose::Payload), context));
        }
        if let Some(row) = rows.thrusters {
            let whole = ThrusterLoss { count: 0, ..ThrusterLoss::default() };
            let loss = disturbance.thrusters.as_ref().unwrap_or(&whole);
            memory.set_all(row, loss.draw(&stream(Purpose::Thrusters), context));
        }
        if let (Some([row, _]), Some(script)) = (rows.script, &disturbance.script) {
            script.begin(memory, row);
        }
        if let Some(sensors) = &rows.sensors {
            sensors.begin(disturbance.noise.as_ref(), memory, &stream(Purpose::Bias), context.joints);
            if let (Some(row), Some(delay)) = (sensors.age, &disturbance.delay) {
                let share = stream(Purpose::Delay).uniform(0);
                memory.set(row, delay.in_periods(context.period, share) as f64);
            }
            self.sample_sensors(memory, key, 0);
        }
    }

    /// Advances one instance before control period `step`: draws, and the next event after one that is over.
    pub fn advance(&self, memory: &mut Column<'_, T>, key: EpisodeKey, step: u32) {
        let (rows, now) = (&self.rows, f64::from(step));
        if let Some([_, draws]) = rows.drift {
            memory.set_all(draws, Stream::new(key, Purpose::Drift).quad(step.wrapping_add(FIRST)));
        }
        if let Some(row) = rows.gust {
            Gust::renew(memory, row, now, &Gust::stream(key), &self.context);
        }
        if let Some(row) = rows.impulse {
            Impulse::renew(memory, row, now, &Impulse::stream(key));
        }
        if let Some([row, _]) = rows.script {
            Script::turn_to(memory, row, step);
        }
        self.sample_sensors(memory, key, step.wrapping_add(1));
    }

    fn sample_sensors(&self, memory: &mut Column<'_, T>, key: EpisodeKey, instant: u32) {
        let Some(SensorRows { measured, noise: Some([_, draws]), .. }) = self.rows.sensors else { return };
        let stream = Stream::new(key, Purpose::Noise);
        for k in 0..measured.div_ceil(QUAD) {
            memory.set_all(draws + QUAD * k, stream.quad(instant.wrapping_mul(NOISE).wrapping_add(k as u32)));
        }
    }

    /// Event of the payload before control period `step`.
    pub fn payload_event(&self, memory: &Column<'_, T>, step: u32) -> Option<PayloadEvent> {
        Payload::event(memory.get_all(self.rows.payload?), f64::from(step))
    }

    /// True where there may be a payload.
    pub fn loads(&self) -> bool {
        self.rows.payload.is_some()
    }

    /// Sets the payload held from now on, kg.
    pub fn hold(&self, memory: &mut Column<'_, T>, held: f64) {
        if let Some(row) = self.rows.payload {
            memory.set(row + Payload::ROWS - 1, held);
        }
    }

    /// Forcing over the coming control period.
    #[inline(always)]
    pub fn forcing<L: Lane<Real = T>>(&self, memory: &Rows<'_, T>, pose: &Pose<L>, twist: &Vector6<L>) -> Forcing<L> {
        let rows = &self.rows;
        let now: L = memory.get(rows.clock);
        let [forward, left, up] = [self.axis(0), self.axis(1), self.axis(2)];
        let mut velocity = Vector3(memory.get_all(rows.steady));
        let mut acceleration = Vector3::zero();
        let mut wrench = Vector6::zero();
        if let Some([row, _]) = rows.drift {
            let Vector3([x, y, z]) = Drift::velocity(memory, row);
            velocity = forward.scale_add(x, left.scale_add(y, up.scale_add(z, velocity)));
        }
        if let Some(row) = rows.gust {
            velocity = velocity + Gust::velocity(memory, row, now);
        }
        if let Some([row, _]) = rows.script {
            let (current, push) = Script::now(memory, row);
            velocity = velocity + current;
            wrench = push;
        }
        if let Some([row, trains]) = rows.waves {
            let [flow, change] = Waves::flow(memory, row, trains, pose.position, up, L::splat(self.frequency));
            velocity = velocity + flow;
            acceleration = change;
        }
        if let Some(row) = rows.impulse {
            wrench = wrench + Impulse::wrench(memory, row, now, &pose.rotation);
        }
        if let Some(row) = rows.tether {
            wrench = wrench + Tether::wrench(memory, row, pose, twist, velocity, up);
        }
        let payload = match rows.payload {
            Some(row) => memory.get(row + Payload::ROWS - 1),
            None => L::zero(),
        };
        let gains = match rows.thrusters {
            Some(row) => ThrusterLoss::gains(memory, row, self.context.thrusters, now),
            None => [L::c(1.0); THRUSTERS],
        };
        Forcing { velocity, acceleration, wrench, gains, payload }
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
        if let Some([row, draws]) = rows.drift {
            let [a, b, c, d]: [L; QUAD] = memory.get_all(draws);
            let ([x, y], [z, _]) = (normal_pair([a, b]), normal_pair([c, d]));
            Drift::pass(memory, row, [x, y, z]);
        }
        if let Some([row, trains]) = rows.waves {
            Waves::pass::<T, L>(memory, row, trains);
        }
    }

    /// Orbital motion of the water around `place` (world axes, m) at the control instant; none without waves.
    #[inline(always)]
    pub fn wave_orbit<L: Lane<Real = T>>(&self, memory: &Rows<'_, T>, place: Vector3<L>) -> WaveOrbit<L> {
        match self.rows.waves {
            Some([row, trains]) => Waves::orbit(memory, row, trains, place, self.axis(2), L::splat(self.frequency)),
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
struct Period<'a, 'b, T: Real, L: Lane> {
    kernel: &'a DisturbanceKernel<T>,
    memory: &'a mut Rows<'b, T>,
    pose: &'a Pose<L>,
    twist: &'a Vector6<L>,
    current: usize,
    forcing: &'a mut Forcing<L>,
}

impl<T: Real, L: Lane<Real = T>> Routine<L> for Period<'_, '_, T, L> {
    #[inline(always)]
    fn run(&mut self) {
        let Self { kernel, memory, pose, twist, current, forcing } = self;
        **forcing = kernel.forcing(memory, pose, twist);
        kernel.record(memory, *current, forcing);
        kernel.end_period::<L>(memory);
    }
}

//! Surface waves.

use super::column::Column;
use super::component::{Component, Draws, Forcing, Moment, Place, component};
use super::context::DisturbanceContext;
use super::span::{Bounded, Span, refuse};
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows, exp, sin_cos};
use crate::lie::Vector3;

/// Maximum number of wave trains.
pub const TRAINS: usize = 3;

component! {
    /// Waves by linear (Airy) theory in deep water, at the vehicle's place: the water's velocity, and its local
    /// acceleration. The convective term of the acceleration is dropped, the waves are taken to
    /// be long against the vehicle, and the motion decays with depth, `exp(k z)`. The free surface itself is not simulated.
    pub struct Waves = "waves" {
        /// Height from trough to crest of each train, m.
        height: Span = Span::of(0.2, 0.5), in 0.0, 20.0;
        /// Period, s.
        period: Span = Span::of(4.0, 7.0), in 1.0, 60.0;
        /// Depth of the world origin below the surface, m.
        depth: Span = Span::of(2.0, 5.0), in 0.0, 1e4;
        /// Trains of waves, each with its own height, period and direction: 1 to 3.
        trains: usize = 1;
    }
}

/// Minimum angular frequency of a train, rad/s.
const MIN_FREQUENCY: f64 = 0.01;

/// Motion of water particles around their mean place, world axes.
#[derive(Debug, Clone, Copy)]
pub struct WaveOrbit<L> {
    /// Displacement from the mean place, m.
    pub displacement: Vector3<L>,
    /// Its rate, m/s.
    pub velocity: Vector3<L>,
    /// Slope of the surfaces of equal depth as a small rotation vector, rad.
    pub slope: Vector3<L>,
    /// Its rate, rad/s.
    pub slope_rate: Vector3<L>,
}

impl<L: Lane> WaveOrbit<L> {
    /// Still water.
    #[inline(always)]
    pub fn zero() -> Self {
        let zero = Vector3::zero();
        Self { displacement: zero, velocity: zero, slope: zero, slope_rate: zero }
    }
}

impl Waves {
    /// Rows common to all trains: depth.
    const COMMON: usize = 1;
    /// Numbers of each train: speed at the origin's depth, wave number, phase and its rate per period, direction (3).
    const EACH: usize = 7;

    /// Velocity of the water at `place` (world axes, m) at the control instant, m/s, and its acceleration half a period
    /// later, m/s^2. `up` points against gravity; `frequency` is one over the control period.
    #[inline(always)]
    fn flow<L: Lane>(
        memory: &Rows<'_, L::Real>,
        at: Place,
        place: Vector3<L>,
        up: Vector3<L>,
        frequency: L,
    ) -> [Vector3<L>; 2] {
        let (mut velocity, mut acceleration) = (Vector3::zero(), Vector3::zero());
        // Above the surface the motion is that at the surface.
        let height = place.dot(up).min(memory.get(at.row));
        for k in 0..at.size {
            let [speed, number, phase, pace, x, y, z]: [L; Self::EACH] =
                memory.get_all(at.row + Self::COMMON + Self::EACH * k);
            let along = Vector3([x, y, z]);
            let speed = speed * exp(number * height);
            // eta = a cos(theta), theta = k x - omega t.
            let theta = number.mul_add(place.dot(along), -phase);
            let (sine, cosine) = sin_cos(theta);
            velocity = velocity + along.scale(speed * cosine) + up.scale(speed * sine);
            let (sine, cosine) = sin_cos(pace.mul_add(L::c(-0.5), theta));
            let rate = speed * pace * frequency;
            acceleration = acceleration + along.scale(rate * sine) - up.scale(rate * cosine);
        }
        [velocity, acceleration]
    }

    /// Motion of the water particles around `place` (world axes, m) at the control instant: their displacement from their
    /// mean place, and the slope of the surfaces of equal depth. Both vanish without waves.
    #[inline(always)]
    pub(super) fn orbit<L: Lane>(
        memory: &Rows<'_, L::Real>,
        at: Place,
        place: Vector3<L>,
        up: Vector3<L>,
        frequency: L,
    ) -> WaveOrbit<L> {
        let mut orbit = WaveOrbit::zero();
        let height = place.dot(up).min(memory.get(at.row));
        for k in 0..at.size {
            let [speed, number, phase, pace, x, y, z]: [L; Self::EACH] =
                memory.get_all(at.row + Self::COMMON + Self::EACH * k);
            let along = Vector3([x, y, z]);
            let speed = speed * exp(number * height);
            let (sine, cosine) = sin_cos(number.mul_add(place.dot(along), -phase));
            // Amplitude of the displacement, speed / omega; 0 for trains that were not drawn.
            let amplitude = speed / (pace * frequency).max(L::c(MIN_FREQUENCY));
            let axis = along.cross(up);
            orbit.displacement = orbit.displacement - along.scale(amplitude * sine) + up.scale(amplitude * cosine);
            orbit.velocity = orbit.velocity + along.scale(speed * cosine) + up.scale(speed * sine);
            orbit.slope = orbit.slope - axis.scale(number * amplitude * sine);
            orbit.slope_rate = orbit.slope_rate + axis.scale(number * speed * cosine);
        }
        orbit
    }
}

impl Component for Waves {
    const STREAM: u32 = 34;
    const SIZE: &'static str = "waves.trains";

    fn check(&self, context: &DisturbanceContext) -> Result<(), TaskError> {
        if !(1..=TRAINS).contains(&self.trains) {
            return refuse("waves.trains", format!("{} must be 1 to {TRAINS}", self.trains));
        }
        let steepness = 0.142 * 9.81 * self.period.low * self.period.low / std::f64::consts::TAU;
        self.height.high.check("waves.height (of the shortest waves, which break beyond)", 0.0, steepness)?;
        if context.gravity == 0.0 {
            return refuse("waves", "the scene has no gravity, without which there are none".into());
        }
        Ok(())
    }

    fn size(&self) -> usize {
        self.trains
    }

    fn rows(trains: usize, _context: &DisturbanceContext) -> usize {
        Self::COMMON + Self::EACH * trains
    }

    /// Draws the trains; those past the last are still.
    fn begin<T: Real>(&self, memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let Draws { stream: draw, context, .. } = draws;
        let depth = self.depth.at(draw.uniform(0));
        memory.set(at.row, depth);
        for k in 0..at.size {
            let uniform = |i| draw.uniform(1 + 8 * k as u32 + i);
            let height = if k < self.trains { self.height.at(uniform(0)) } else { 0.0 };
            let frequency = std::f64::consts::TAU / self.period.at(uniform(1));
            let phase = std::f64::consts::TAU * uniform(2);
            let direction = context.direction([uniform(3), 0.5], 0.0);
            let number = frequency * frequency / context.gravity;
            let speed = 0.5 * height * frequency * (-number * depth).exp();
            let start = at.row + Self::COMMON + Self::EACH * k;
            memory.set_all(start, [speed, number, phase, frequency * context.period]);
            memory.set_all(start + 4, direction.iter().copied());
        }
    }

    #[inline(always)]
    fn add<L: Lane>(memory: &Rows<'_, L::Real>, at: Place, moment: &Moment<'_, L>, forcing: &mut Forcing<L>) {
        let (place, up) = (moment.pose.position, moment.level[2]);
        let [velocity, acceleration] = Self::flow(memory, at, place, up, moment.frequency);
        forcing.velocity = forcing.velocity + velocity;
        forcing.acceleration = acceleration;
    }

    /// Advances the phases by a period. They are kept within a turn, so that they stay exact in episodes of any length.
    #[inline(always)]
    fn end_period<L: Lane>(memory: &mut Rows<'_, L::Real>, at: Place) {
        use std::f64::consts::TAU;
        for k in 0..at.size {
            let row = at.row + Self::COMMON + Self::EACH * k + 2;
            let [phase, pace]: [L; 2] = memory.get_all(row);
            let phase = phase + pace;
            memory.set(row, (phase * L::c(1.0 / TAU)).round().neg_mul_add(L::c(TAU), phase));
        }
    }
}

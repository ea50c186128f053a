//! Currents: steady, drifting, and gusts.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::column::Column;
use super::context::DisturbanceContext;
use super::span::{Span, check};
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows};
use crate::lie;
use crate::task::EpisodeKey;
use crate::task::random::{Purpose, Stream};

/// Maximum speed of the water, m/s.
pub(super) const FASTEST: f64 = 5.0;
/// Maximum elevation: straight up or down, rad.
pub(super) const STEEPEST: f64 = std::f64::consts::FRAC_PI_2;

/// A steady current, on top of the scene's own: drawn at an episode's start.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SteadyCurrent {
    /// Speed, m/s.
    pub speed: Span,
    /// Maximum angle against the horizontal, rad.
    pub elevation: f64,
}

impl Default for SteadyCurrent {
    fn default() -> Self {
        Self::up_to(0.3)
    }
}

impl SteadyCurrent {
    /// Current of any speed up to this one, m/s.
    pub fn up_to(speed: f64) -> Self {
        Self { speed: Span::of(0.0, speed), elevation: 0.25 }
    }

    pub(super) fn check(&self) -> Result<(), TaskError> {
        self.speed.check("current.speed", 0.0, FASTEST)?;
        check("current.elevation", self.elevation, 0.0, STEEPEST)
    }

    /// Its velocity in world axes, m/s.
    pub(in crate::task) fn draw(&self, draw: &Stream, context: &DisturbanceContext) -> Vector3<f64> {
        let azimuth = draw.uniform_in(0, 0.0, std::f64::consts::TAU);
        let elevation = draw.uniform_in(1, -self.elevation, self.elevation);
        let [forward, left, up] = context.level;
        let level = forward * azimuth.cos() + left * azimuth.sin();
        (level * elevation.cos() + up * elevation.sin()) * draw.uniform_in(2, self.speed.low, self.speed.high)
    }
}

/// A drifting current: in each direction a Gauss-Markov process, `x' = -x / time + noise`, discretised exactly. It is
/// held over each control period.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Drift {
    /// Standard deviation along each horizontal axis, m/s.
    pub deviation: Span,
    /// Time over which the correlation falls to 1/e, s.
    pub time: Span,
    /// Vertical deviation over the horizontal one.
    pub vertical: f64,
}

impl Default for Drift {
    fn default() -> Self {
        Self { deviation: Span::of(0.03, 0.08), time: Span::of(5.0, 20.0), vertical: 0.3 }
    }
}

impl Drift {
    /// Rows in level axes: velocity (3), its decay per period, deviation of the increments (horizontal, vertical).
    pub(super) const ROWS: usize = 6;

    pub(super) fn check(&self) -> Result<(), TaskError> {
        self.deviation.check("drift.deviation", 0.0, 1.0)?;
        self.time.check("drift.time", 1e-3, 1e6)?;
        check("drift.vertical", self.vertical, 0.0, 10.0)
    }

    pub(super) fn draw(&self, draw: &Stream, context: &DisturbanceContext) -> [f64; Self::ROWS] {
        let (deviation, time) = (self.deviation.at(draw.uniform(0)), self.time.at(draw.uniform(1)));
        let keep = (-context.period / time).exp();
        // 1 - keep^2, without cancellation.
        let kick = deviation * (-(-2.0 * context.period / time).exp_m1()).sqrt();
        let at = |axis: u32, deviation: f64| deviation * draw.normal(2 + axis);
        let vertical = self.vertical;
        [at(0, deviation), at(1, deviation), at(2, vertical * deviation), keep, kick, vertical * kick]
    }

    /// Its velocity in level axes, m/s.
    #[inline(always)]
    pub(super) fn velocity<T: Real, L: Lane<Real = T>>(memory: &Rows<'_, T>, row: usize) -> lie::Vector3<L> {
        lie::Vector3(memory.get_all(row))
    }

    /// Advances by a period with these three normal numbers.
    #[inline(always)]
    pub(super) fn pass<T: Real, L: Lane<Real = T>>(memory: &mut Rows<'_, T>, row: usize, normal: [L; 3]) {
        let [x, y, z, keep, kick, lift]: [L; Self::ROWS] = memory.get_all(row);
        let next = [x * keep + kick * normal[0], y * keep + kick * normal[1], z * keep + lift * normal[2]];
        memory.set_all(row, &next);
    }
}

/// Gusts: the current rises smoothly, lasts, and falls as it rose; after a pause the next one follows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Gust {
    /// Speed, m/s.
    pub speed: Span,
    /// Time to rise and to fall, s.
    pub rise: f64,
    /// Time from the start of the rise to the start of the fall, s.
    pub duration: Span,
    /// Time from the episode's start, or the end of the gust before, to the start of the rise, s.
    pub pause: Span,
    /// Maximum angle against the horizontal, rad.
    pub elevation: f64,
    /// True where it reverses half-way.
    pub turns: bool,
}

impl Default for Gust {
    fn default() -> Self {
        Self {
            speed: Span::of(0.1, 0.3),
            rise: 1.0,
            duration: Span::of(2.0, 6.0),
            pause: Span::of(1.0, 6.0),
            elevation: 0.25,
            turns: false,
        }
    }
}

impl Gust {
    /// Times in control periods: start of rise and of fall, one over the rise; velocity (3); reversal (0 or 1); number
    /// of gusts so far. Then the ranges of the next one: speed, duration and pause (2 each), elevation.
    pub(super) const ROWS: usize = 15;

    pub(super) fn check(&self) -> Result<(), TaskError> {
        self.speed.check("gust.speed", 0.0, FASTEST)?;
        check("gust.rise", self.rise, 0.0, 1e4)?;
        self.duration.check("gust.duration", 0.0, 1e6)?;
        self.pause.check("gust.pause", 0.0, 1e6)?;
        check("gust.elevation", self.elevation, 0.0, STEEPEST)
    }

    pub(super) fn begin<T: Real>(
        &self,
        memory: &mut Column<'_, T>,
        row: usize,
        draw: &Stream,
        context: &DisturbanceContext,
    ) {
        let [minimum, longest] = self.duration.in_periods(context.period);
        let [soon, late] = self.pause.in_periods(context.period);
        // At least a period; shorter times are steps.
        let rise = 1.0 / (self.rise / context.period).max(1.0);
        memory.set(row + 2, rise);
        memory.set(row + 6, f64::from(u8::from(self.turns)));
        memory.set(row + 7, 0.0);
        let Span { low, high } = self.speed;
        memory.set_all(row + 8, [low, high, minimum, longest, soon, late, self.elevation]);
        Self::draw(memory, row, 0.0, draw, context);
    }

    /// Draws the next gust, after the time `now`.
    fn draw<T: Real>(memory: &mut Column<'_, T>, row: usize, now: f64, draw: &Stream, context: &DisturbanceContext) {
        let [count, low, high, minimum, longest, soon, late, elevation] = memory.get_all(row + 7);
        let uniform = |k| draw.uniform((8.0 * count) as u32 + k);
        let start = now + Span::of(soon, late).at(uniform(0));
        let end = start + Span::of(minimum, longest).at(uniform(1));
        let speed = Span::of(low, high).at(uniform(2));
        let velocity = context.direction([uniform(3), uniform(4)], elevation) * speed;
        memory.set_all(row, [start, end]);
        memory.set_all(row + 3, velocity.iter().copied());
        memory.set(row + 7, count + 1.0);
    }

    /// Draws the next gust once the last one is over.
    pub(super) fn renew<T: Real>(
        memory: &mut Column<'_, T>,
        row: usize,
        now: f64,
        draw: &Stream,
        context: &DisturbanceContext,
    ) {
        let over = memory.get(row + 1) + 1.0 / memory.get(row + 2);
        if now >= over {
            Self::draw(memory, row, now, draw, context);
        }
    }

    /// Its velocity in world axes, m/s.
    #[inline(always)]
    pub(super) fn velocity<T: Real, L: Lane<Real = T>>(memory: &Rows<'_, T>, row: usize, now: L) -> lie::Vector3<L> {
        let [start, end, rise, x, y, z, turns]: [L; 7] = memory.get_all(row);
        let middle = (start + end) * L::c(0.5);
        let up = smooth_step((now - start) * rise);
        let round = smooth_step((now - middle) * rise);
        let down = smooth_step((now - end) * rise);
        // up - down; with a turn up - 2 round + down.
        let twice = turns + turns;
        let strength = up - twice * round - (L::c(1.0) - twice) * down;
        lie::Vector3([x, y, z]).scale(strength)
    }

    /// Stream of the gusts.
    pub(super) fn stream(key: EpisodeKey) -> Stream {
        Stream::new(key, Purpose::Gust)
    }
}

/// Smooth step from 0 to 1 over x in [0, 1], with zero slope there and beyond.
#[inline(always)]
pub fn smooth_step<L: Lane>(x: L) -> L {
    let x = x.min(L::c(1.0)).max(L::zero());
    x * x * x.mul_add(L::c(-2.0), L::c(3.0))
}

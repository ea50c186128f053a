//! Currents: steady, drifting, and gusts.

use nalgebra::Vector3;

use super::column::Column;
use super::component::{Component, Draws, Forcing, Moment, Place, QUAD, component, normal_pair};
use super::context::DisturbanceContext;
use super::span::Span;
use crate::lane::{Lane, Real, Rows};
use crate::lie;
use crate::task::random::Stream;

/// Maximum speed of the water, m/s.
pub(super) const FASTEST: f64 = 5.0;
/// Maximum elevation: straight up or down, rad.
pub(super) const STEEPEST: f64 = std::f64::consts::FRAC_PI_2;

component! {
    /// A steady current, on top of the scene's own: drawn at an episode's start.
    pub struct SteadyCurrent = "current" {
        /// Speed, m/s.
        speed: Span = Span::of(0.0, 0.3), in 0.0, FASTEST;
        /// Maximum angle against the horizontal, rad.
        elevation: f64 = 0.25, in 0.0, STEEPEST;
    }
}

impl SteadyCurrent {
    /// Current of any speed up to this one, m/s.
    pub fn up_to(speed: f64) -> Self {
        Self { speed: Span::of(0.0, speed), elevation: 0.25 }
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

impl Component for SteadyCurrent {
    const RESERVED: bool = false;
}

/// Draws reserved at the start of a drift's stream; the draws of control periods follow.
const FIRST: u32 = 16;

component! {
    /// A drifting current: in each direction a Gauss-Markov process, `x' = -x / time + noise`, discretised exactly. It is
    /// constant over each control period.
    pub struct Drift = "drift" {
        /// Standard deviation along each horizontal axis, m/s.
        deviation: Span = Span::of(0.03, 0.08), in 0.0, 1.0;
        /// Time over which the correlation falls to 1/e, s.
        time: Span = Span::of(5.0, 20.0), in 1e-3, 1e6;
        /// Vertical deviation over the horizontal one.
        vertical: f64 = 0.3, in 0.0, 10.0;
    }
}

impl Drift {
    /// Rows in level axes: velocity (3), its decay per period, deviation of the increments (horizontal, vertical).
    const STATE: usize = 6;

    fn draw(&self, draw: &Stream, context: &DisturbanceContext) -> [f64; Self::STATE] {
        let (deviation, time) = (self.deviation.at(draw.uniform(0)), self.time.at(draw.uniform(1)));
        let keep = (-context.period / time).exp();
        // 1 - keep^2, without cancellation.
        let kick = deviation * (-(-2.0 * context.period / time).exp_m1()).sqrt();
        let at = |axis: u32, deviation: f64| deviation * draw.normal(2 + axis);
        let vertical = self.vertical;
        [at(0, deviation), at(1, deviation), at(2, vertical * deviation), keep, kick, vertical * kick]
    }
}

impl Component for Drift {
    const STREAM: u32 = 32;
    /// The state, then uniform draws of a control period.
    const ROWS: usize = Self::STATE + QUAD;

    fn begin<T: Real>(&self, memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let Draws { stream: draw, context, .. } = draws;
        memory.set_all(at.row, self.draw(draw, context));
    }

    fn renew<T: Real>(memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let Draws { stream: draw, step, .. } = *draws;
        memory.set_all(at.row + Self::STATE, draw.quad(step.wrapping_add(FIRST)));
    }

    #[inline(always)]
    fn add<L: Lane>(memory: &Rows<'_, L::Real>, at: Place, moment: &Moment<'_, L>, forcing: &mut Forcing<L>) {
        let [x, y, z]: [L; 3] = memory.get_all(at.row);
        let [forward, left, up] = *moment.level;
        forcing.velocity = forward.scale_add(x, left.scale_add(y, up.scale_add(z, forcing.velocity)));
    }

    #[inline(always)]
    fn end_period<L: Lane>(memory: &mut Rows<'_, L::Real>, at: Place) {
        let [a, b, c, d]: [L; QUAD] = memory.get_all(at.row + Self::STATE);
        let ([nx, ny], [nz, _]) = (normal_pair([a, b]), normal_pair([c, d]));
        let [x, y, z, keep, kick, lift]: [L; Self::STATE] = memory.get_all(at.row);
        let next = [x * keep + kick * nx, y * keep + kick * ny, z * keep + lift * nz];
        memory.set_all(at.row, &next);
    }
}

component! {
    /// Gusts: the current rises smoothly, lasts, and falls as it rose; after a pause the next one follows.
    pub struct Gust = "gust" {
        /// Speed, m/s.
        speed: Span = Span::of(0.1, 0.3), in 0.0, FASTEST;
        /// Time to rise and to fall, s.
        rise: f64 = 1.0, in 0.0, 1e4;
        /// Time from the start of the rise to the start of the fall, s.
        duration: Span = Span::of(2.0, 6.0), in 0.0, 1e6;
        /// Time from the episode's start, or the end of the gust before, to the start of the rise, s.
        pause: Span = Span::of(1.0, 6.0), in 0.0, 1e6;
        /// Maximum angle against the horizontal, rad.
        elevation: f64 = 0.25, in 0.0, STEEPEST;
        /// True where it reverses half-way.
        turns: bool = false;
    }
}

impl Gust {
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
}

impl Component for Gust {
    const STREAM: u32 = 33;
    /// Times in control periods: start of rise and of fall, one over the rise; velocity (3); reversal (0 or 1); number
    /// of gusts so far. Then the ranges of the next one: speed, duration and pause (2 each), elevation.
    const ROWS: usize = 15;

    fn begin<T: Real>(&self, memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let Draws { stream: draw, context, .. } = draws;
        let [shortest, longest] = self.duration.in_periods(context.period);
        let [soon, late] = self.pause.in_periods(context.period);
        // At least a period; shorter times are steps.
        let rise = 1.0 / (self.rise / context.period).max(1.0);
        memory.set(at.row + 2, rise);
        memory.set(at.row + 6, f64::from(u8::from(self.turns)));
        memory.set(at.row + 7, 0.0);
        let Span { low, high } = self.speed;
        memory.set_all(at.row + 8, [low, high, shortest, longest, soon, late, self.elevation]);
        Self::draw(memory, at.row, 0.0, draw, context);
    }

    /// Draws the next gust once the last one is over.
    fn renew<T: Real>(memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let Draws { stream: draw, step, context } = *draws;
        let (now, over) = (f64::from(step), memory.get(at.row + 1) + 1.0 / memory.get(at.row + 2));
        if now >= over {
            Self::draw(memory, at.row, now, &draw, context);
        }
    }

    #[inline(always)]
    fn add<L: Lane>(memory: &Rows<'_, L::Real>, at: Place, moment: &Moment<'_, L>, forcing: &mut Forcing<L>) {
        let [start, end, rise, x, y, z, turns]: [L; 7] = memory.get_all(at.row);
        let (now, middle) = (moment.now, (start + end) * L::c(0.5));
        let up = smooth_step((now - start) * rise);
        let round = smooth_step((now - middle) * rise);
        let down = smooth_step((now - end) * rise);
        // up - down; with a turn up - 2 round + down.
        let twice = turns + turns;
        let strength = up - twice * round - (L::c(1.0) - twice) * down;
        forcing.velocity = forcing.velocity + lie::Vector3([x, y, z]).scale(strength);
    }
}

/// Smooth step from 0 to 1 over x in [0, 1], with zero slope there and beyond.
#[inline(always)]
pub fn smooth_step<L: Lane>(x: L) -> L {
    let x = x.min(L::c(1.0)).max(L::zero());
    x * x * x.mul_add(L::c(-2.0), L::c(3.0))
}

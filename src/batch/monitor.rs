//! The watch on motions while they are stepped: what no look at the scene can see beforehand.

use std::fmt;

use super::columns::Columns;
use super::layout::Layout;
use super::rates::{Others, digits};
use super::simulator::{Simulator, SimulatorOptions};
use super::table::Table;
use crate::dynamics::Servos;
use crate::integrate::{Watch as Seen, step_error, stiffness};
use crate::lane::{Isa, Kernel, Lane, Real};

/// Share of its speed that the last steps of a motion may get wrong.
pub const WRONG: f64 = 0.05;

/// What steps showed of a motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Watched {
    /// `h |rate|` of the fastest rate that it excites.
    pub stiffness: f64,
    /// Share of its speed that the last steps got wrong.
    pub error: f64,
}

/// What motions are watched for leaving.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Of [`Watched::stiffness`].
    pub stiffness: f64,
    /// Of [`Watched::error`].
    pub error: f64,
}

/// An instance whose motion a step does not follow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Instance.
    pub instance: usize,
    /// Its time, s.
    pub time: f64,
    /// What its motion showed.
    pub watched: Watched,
    /// Whether its state is finite.
    pub finite: bool,
}

impl Table {
    /// The first of `count` instances that is not finite or whose motion is beyond the bounds.
    pub(super) fn sight<T: Real>(
        &self,
        isa: Isa,
        rows: &mut [T],
        count: usize,
        bounds: Bounds,
        h: f64,
    ) -> Option<Sighting> {
        let width = self.layout.rows * T::BLOCK;
        let mut first = 0;
        loop {
            // Block by block in lanes; then one by one within the block where something may be.
            let blocks = &mut rows[first * self.layout.rows..];
            let count = count.saturating_sub(first);
            let mut look = Look { layout: &self.layout, bounds, h, count, blocks, astray: None };
            T::dispatch(isa, &mut look);
            first += look.astray? * T::BLOCK;
            let block = &rows[first * self.layout.rows..][..width];
            let found = (first..count.min(first + T::BLOCK)).find_map(|i| self.astray(block, i - first, bounds, h));
            if let Some(sighting) = found {
                return Some(Sighting { instance: first + sighting.instance, ..sighting });
            }
            first += T::BLOCK;
        }
    }

    /// What is to be said of instance `i` if it is not finite or its motion is beyond the bounds.
    fn astray<T: Real>(&self, rows: &[T], i: usize, bounds: Bounds, h: f64) -> Option<Sighting> {
        let watched = self.watched(rows, i, h);
        let follows = watched.stiffness <= bounds.stiffness && watched.error <= bounds.error;
        // The state is what comes before the time.
        let finite = (0..self.layout.time).all(|row| self.get(rows, i, row).is_finite());
        (!finite || !follows).then(|| Sighting { instance: i, time: self.state(rows, i).time, watched, finite })
    }
}

/// Looks for the first block in which an instance may not be finite or may be beyond the bounds.
struct Look<'a, T> {
    layout: &'a Layout,
    bounds: Bounds,
    h: f64,
    /// Instances: columns past them need not be looked at.
    count: usize,
    blocks: &'a mut [T],
    astray: Option<usize>,
}

impl<T: Real> Kernel<T> for Look<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        let blocks = std::mem::take(&mut self.blocks).chunks_exact_mut(self.layout.rows * T::BLOCK);
        for (k, rows) in blocks.enumerate() {
            for first in (0..T::BLOCK).step_by(L::LANES) {
                if k * T::BLOCK + first >= self.count {
                    break;
                }
                let columns = Columns { rows: &mut *rows, first };
                // Zero times each number of the state, which is what comes before the time: NaN for one that is not
                // finite. In four sums, which need not wait for each other.
                let mut sums = [L::zero(); 4];
                for row in 0..self.layout.time {
                    sums[row % 4] = columns.get::<L>(row).mul_add(L::zero(), sums[row % 4]);
                }
                let sum = (sums[0] + sums[1]) + (sums[2] + sums[3]);
                let Seen::<L> { contrast, slip, spin, .. } = columns.watch(self.layout);
                let stiffness = stiffness(contrast, T::EPSILON);
                let error = step_error([slip[0], slip[1], spin], self.h);
                let follows = L::and(stiffness.lt(L::c(self.bounds.stiffness)), error.lt(L::c(self.bounds.error)));
                let sound = L::and(sum.lt(L::c(1.0)), follows);
                if L::bits(sound).count_ones() as usize != L::LANES {
                    self.astray = Some(k);
                    return;
                }
            }
        }
    }
}

/// What was looked at, seen and told already.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Watch {
    /// By servos that are on.
    looked: [bool; 4],
    warned: bool,
    sighted: Option<Sighting>,
    told: bool,
}

impl Watch {
    /// Whether to look for unstable modes under these servos: once, and not after a warning.
    pub fn looks(&mut self, servos: Servos) -> bool {
        !self.warned && !std::mem::replace(&mut self.looked[servos.index()], true)
    }

    /// There was a warning of an unstable mode.
    pub fn warned(&mut self) {
        self.warned = true;
    }

    /// Whether motions are still watched: until the first sighting.
    pub fn watches(&self) -> bool {
        self.sighted.is_none()
    }

    /// Whether it was said already that the step is too great.
    pub fn has_warned(&self) -> bool {
        self.warned
    }

    /// Remembers the first sighting.
    pub fn sighted(&mut self, sighting: Option<Sighting>) {
        self.sighted = self.sighted.or(sighting);
    }
}

/// A motion that the steps do not follow; displays as a warning of one line.
#[derive(Debug, Clone, PartialEq)]
pub struct Stray {
    /// Name of the scene.
    pub scene: String,
    /// Name of the integrator.
    pub integrator: String,
    /// The step, s.
    pub dt: f64,
    /// `h |rate|` up to which the integrator is right.
    pub range: f64,
    /// What was seen.
    pub sighting: Sighting,
}

impl fmt::Display for Stray {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, integrator, dt, range, sighting } = self;
        let Sighting { instance, time, watched: Watched { stiffness, error }, finite } = *sighting;
        write!(f, "scene '{scene}': ")?;
        if finite {
            write!(f, "instance {instance} is wrong")?;
        } else {
            write!(f, "the state of instance {instance} is no longer finite")?;
        }
        write!(f, " at t = {time:.6} s: integrator '{integrator}' at dt = {dt} s")?;
        if stiffness.is_finite() && stiffness > 0.0 {
            write!(f, ", motion with a rate of {} 1/s, h |rate| = {}", digits(stiffness / dt), digits(stiffness))?;
        }
        if range.is_finite() {
            write!(f, ", right up to h |rate| = {}", digits(*range))?;
        }
        if error.is_finite() && error > WRONG {
            write!(f, ", the last steps wrong by {:.1} % of the speed", 100.0 * error)?;
        }
        write!(f, "; take a smaller dt{Others}")
    }
}

impl Simulator {
    /// What to warn of after steps, once: the first instance that became infinite or NaN, whose motion excited rates
    /// beyond [`crate::integrate::Integrator::range`], or of whose speed the steps got more than [`WRONG`] wrong.
    pub fn warn_of_motion(&mut self) -> Option<Stray> {
        let range = self.range();
        let watch = self.watch_mut();
        let sighting = watch.sighted.filter(|_| !watch.told)?;
        watch.told = true;
        let SimulatorOptions { dt, integrator, .. } = self.options().clone();
        Some(Stray { scene: self.scene().name.clone(), integrator, dt, range, sighting })
    }
}

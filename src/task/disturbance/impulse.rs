//! Pushes.

use super::column::Column;
use super::component::{Component, Draws, Forcing, Moment, Place, component};
use super::span::Span;
use crate::lane::{Lane, Real, Rows};
use crate::lie::{Vector3, Vector6};
use crate::task::random::Stream;

component! {
    /// Pushes at random times: a constant force for a short time, from any side, at a point of the vehicle. Each
    /// control period applies the mean over the period, so that the momentum does not depend on the start within it.
    pub struct Impulse = "impulse" {
        /// Force relative to the maximum thrust along the vehicle's weakest axis.
        share: Span = Span::of(0.3, 1.0), in 0.0, 10.0;
        /// Force, N; in place of the share.
        #[serde(skip_serializing_if = "Option::is_none")]
        force: Option<Span> = None, in 0.0, 1e7;
        /// Duration, s.
        duration: Span = Span::of(0.1, 0.4), in 0.0, 1e4;
        /// Time from the episode's start, or the end of the push before, s.
        pause: Span = Span::of(2.0, 6.0), in 0.0, 1e6;
        /// Maximum distance of the point from the vehicle's origin relative to the root mean square distance of its thrusters.
        reach: f64 = 0.5, in 0.0, 10.0;
    }
}

impl Impulse {
    fn draw<T: Real>(memory: &mut Column<'_, T>, row: usize, now: f64, draw: &Stream) {
        let [count, low, high, minimum, longest, soon, late, reach] = memory.get_all(row + 8);
        let index = |k| (8.0 * count) as u32 + k;
        let start = now + Span::of(soon, late).at(draw.uniform(index(0)));
        let end = start + Span::of(minimum, longest).at(draw.uniform(index(1)));
        let force = draw.unit_vector(index(2)) * Span::of(low, high).at(draw.uniform(index(3)));
        let point = draw.unit_vector(index(4)) * (reach * draw.uniform(index(5)));
        memory.set_all(row, [start, end]);
        memory.set_all(row + 2, force.iter().chain(&point).copied());
        memory.set(row + 8, count + 1.0);
    }
}

impl Component for Impulse {
    const STREAM: u32 = 35;
    /// Start and end in control periods; force (3, world) and point (3, body); number of pushes so far. Then the ranges of
    /// the next one: force, duration and pause (2 each), reach.
    const ROWS: usize = 16;

    fn begin<T: Real>(&self, memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let Draws { stream: draw, context, .. } = draws;
        let Span { low, high } = self.force.unwrap_or(self.share.times(context.thrust));
        let [shortest, longest] = self.duration.in_periods(context.period);
        let [soon, late] = self.pause.in_periods(context.period);
        memory.set(at.row + 8, 0.0);
        memory.set_all(at.row + 9, [low, high, shortest, longest, soon, late, self.reach * context.lever]);
        Self::draw(memory, at.row, 0.0, draw);
    }

    /// Draws the next push once the last one is over.
    fn renew<T: Real>(memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let Draws { stream: draw, step, .. } = *draws;
        let now = f64::from(step);
        if now >= memory.get(at.row + 1) {
            Self::draw(memory, at.row, now, &draw);
        }
    }

    /// Adds its mean wrench over the coming period.
    #[inline(always)]
    fn add<L: Lane>(memory: &Rows<'_, L::Real>, at: Place, moment: &Moment<'_, L>, forcing: &mut Forcing<L>) {
        let [start, end, fx, fy, fz, px, py, pz]: [L; 8] = memory.get_all(at.row);
        let share = within(end - moment.now) - within(start - moment.now);
        let force = moment.pose.rotation.apply_transposed(Vector3([fx, fy, fz])).scale(share);
        let wrench = Vector6 { linear: force, angular: Vector3([px, py, pz]).cross(force) };
        forcing.wrench = forcing.wrench + wrench;
    }
}

/// Share of the coming period before a time, given in periods from now.
#[inline(always)]
fn within<L: Lane>(time: L) -> L {
    time.min(L::c(1.0)).max(L::zero())
}

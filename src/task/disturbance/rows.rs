//! Rows of the disturbances in an episode's memory.

use super::Disturbance;
use super::context::DisturbanceContext;
use super::current::{Drift, Gust};
use super::draws::QUAD;
use super::impulse::Impulse;
use super::payload::Payload;
use super::script::Script;
use super::sensors::{MEASURED_OF_VEHICLE, SensorRows};
use super::tether::Tether;
use super::thrusters::ThrusterLoss;
use super::waves::Waves;

/// First row of each present component.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DisturbanceRows {
    /// Completed control periods.
    pub clock: usize,
    /// Steady current in world axes, 3.
    pub steady: usize,
    /// Rows of [`super::Forcing::summary`], 3.
    pub summary: usize,
    pub(super) drift: Option<[usize; 2]>,
    pub(super) gust: Option<usize>,
    /// First row, and number of trains.
    pub(super) waves: Option<[usize; 2]>,
    pub(super) impulse: Option<usize>,
    pub(super) tether: Option<usize>,
    pub(super) payload: Option<usize>,
    pub(super) thrusters: Option<usize>,
    /// First row, and number of control periods.
    pub(super) script: Option<[usize; 2]>,
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
        let mut rows = Self {
            clock: take(1),
            steady: take(3),
            summary: take(3),
            drift: disturbance.drift.as_ref().map(|_| [take(Drift::ROWS), take(QUAD)]),
            gust: disturbance.gust.as_ref().map(|_| take(Gust::ROWS)),
            waves: disturbance.waves.as_ref().map(|waves| [take(Waves::rows(waves.trains)), waves.trains]),
            impulse: disturbance.impulse.as_ref().map(|_| take(Impulse::ROWS)),
            tether: disturbance.tether.as_ref().map(|_| take(Tether::ROWS)),
            payload: disturbance.payload.as_ref().map(|_| take(Payload::ROWS)),
            thrusters: disturbance.thrusters.as_ref().map(|_| take(ThrusterLoss::COMMON + context.thrusters)),
            script: disturbance.script.as_ref().map(|script| [take(Script::rows(script.len())), script.len()]),
            sensors: (disturbance.noise.is_some() || periods > 0).then(|| SensorRows {
                measured,
                noise: disturbance.noise.as_ref().map(|_| [take(2 * measured), take(SensorRows::draws(measured))]),
                ring: take((1 + periods) * measured),
                slots: 1 + periods,
                age: (minimum < periods).then(|| take(1)),
            }),
            end: 0,
        };
        rows.end = end;
        let absent = rows.drift.is_none()
            && rows.gust.is_none()
            && rows.waves.is_none()
            && rows.impulse.is_none()
            && rows.tether.is_none()
            && rows.payload.is_none()
            && rows.thrusters.is_none()
            && rows.script.is_none()
            && rows.sensors.is_none();
        (!absent).then_some(rows)
    }

    /// True where the water's velocity changes within an episode.
    pub(super) fn flows(&self) -> bool {
        self.drift.is_some() || self.gust.is_some() || self.waves.is_some() || self.script.is_some()
    }

    /// True where there is an external force.
    pub(super) fn pushes(&self) -> bool {
        self.impulse.is_some() || self.tether.is_some() || self.script.is_some()
    }
}

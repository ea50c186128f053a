//! Interface of the components of a disturbance, and what they do to the physics.

use super::column::Column;
use super::context::DisturbanceContext;
use super::sensors::MEASURED;
use crate::control::THRUSTERS;
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows, ln, sin_cos};
use crate::lie::{Pose, Vector3, Vector6};
use crate::task::random::Stream;

/// Rows of a component in an episode's memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// First row.
    pub row: usize,
    /// [`Component::size`] of the environment's component.
    pub size: usize,
}

/// Draws of a component.
pub struct Draws<'a> {
    /// Its stream in this episode.
    pub stream: Stream,
    /// Number of the coming control period.
    pub step: u32,
    /// The scene's numbers.
    pub context: &'a DisturbanceContext,
}

/// Control instant, as components see it.
#[derive(Debug, Clone, Copy)]
pub struct Moment<'a, L> {
    /// Control periods since the episode's start.
    pub now: L,
    /// Vehicle in the world.
    pub pose: &'a Pose<L>,
    /// Its absolute body twist.
    pub twist: &'a Vector6<L>,
    /// World axes: two horizontal ones and the one against gravity.
    pub level: &'a [Vector3<L>; 3],
    /// Control periods per second.
    pub frequency: L,
    /// Number of thrusters.
    pub thrusters: usize,
}

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

/// Declares the settings of a component by its name: each with its default and, where there is one, the range of its numbers.
macro_rules! component {
    ($(#[$meta:meta])* pub struct $kind:ident = $name:literal {
        $($(#[$doc:meta])* $field:ident: $type:ty = $default:expr $(, in $minimum:expr, $maximum:expr)?;)*
    }) => {
        $crate::task::settings::settings! { $(#[$meta])* pub struct $kind { $($(#[$doc])* $field: $type = $default;)* } }

        impl super::component::Ranges for $kind {
            fn check_ranges(&self) -> Result<(), $crate::error::TaskError> {
                $($(super::span::Bounded::check(
                    &self.$field, concat!($name, ".", stringify!($field)), $minimum, $maximum
                )?;)?)*
                Ok(())
            }
        }
    };
}

pub(super) use component;

/// Ranges of the numbers of a component.
pub trait Ranges {
    /// Refuses numbers out of range.
    ///
    /// # Errors
    /// `TaskError::Disturbance`.
    fn check_ranges(&self) -> Result<(), TaskError>;
}

/// A component of a disturbance. Its draws and its state are in rows of an episode's memory, which are 0 at first.
pub trait Component: Ranges {
    /// Number of its stream of draws, from 32 on; 0 without one.
    const STREAM: u32 = 0;
    /// A reset gives it only where the environment has it.
    const RESERVED: bool = true;
    /// Option that sets [`Self::size`].
    const SIZE: &'static str = "";
    /// It changes measurements.
    const MEASURES: bool = false;
    /// Number of rows, where it is the same for all sizes and scenes.
    const ROWS: usize = 0;

    /// Refuses numbers, each in its range, that do not go together or that the scene does not allow.
    ///
    /// # Errors
    /// `TaskError::Disturbance`.
    fn check(&self, _context: &DisturbanceContext) -> Result<(), TaskError> {
        Ok(())
    }

    /// Size of its memory, where components differ in it.
    fn size(&self) -> usize {
        0
    }

    /// Number of rows at a size.
    fn rows(_size: usize, _context: &DisturbanceContext) -> usize {
        Self::ROWS
    }

    /// Draws an episode.
    fn begin<T: Real>(&self, _memory: &mut Column<'_, T>, _at: Place, _draws: &Draws<'_>) {}

    /// Draws what the control period `draws.step` needs, before it.
    fn renew<T: Real>(_memory: &mut Column<'_, T>, _at: Place, _draws: &Draws<'_>) {}

    /// Adds to the forcing over the coming control period.
    #[inline(always)]
    fn add<L: Lane>(_memory: &Rows<'_, L::Real>, _at: Place, _moment: &Moment<'_, L>, _forcing: &mut Forcing<L>) {}

    /// Changes a measurement, whose last number is its age in control periods; `last` is the one before.
    #[inline(always)]
    fn measure<L: Lane>(_memory: &Rows<'_, L::Real>, _at: Place, _last: &[L; MEASURED], _seen: &mut [L; MEASURED]) {}

    /// Advances its state to the end of a control period.
    #[inline(always)]
    fn end_period<L: Lane>(_memory: &mut Rows<'_, L::Real>, _at: Place) {}
}

/// Uniform numbers of a draw.
pub(super) const QUAD: usize = 4;

/// Two independent normal numbers from two uniform ones in (0, 1] (Box-Muller).
#[inline(always)]
pub(super) fn normal_pair<L: Lane>([u, v]: [L; 2]) -> [L; 2] {
    let radius = (ln(u) * L::c(-2.0)).max(L::zero()).sqrt();
    let (sine, cosine) = sin_cos(v * L::c(std::f64::consts::TAU));
    [radius * cosine, radius * sine]
}

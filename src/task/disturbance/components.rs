//! List of the components of a disturbance.

use serde::{Deserialize, Serialize};

use super::arm::ArmMotion;
use super::battery::Battery;
use super::column::Column;
use super::component::{Component, Draws, Forcing, Moment, Place, Ranges};
use super::context::DisturbanceContext;
use super::current::{Drift, Gust, SteadyCurrent};
use super::dropout::Dropout;
use super::impulse::Impulse;
use super::outliers::Outliers;
use super::parameters::Parameters;
use super::payload::Payload;
use super::script::Script;
use super::sensors::{Delay, MEASURED, Noise};
use super::tether::Tether;
use super::thrusters::ThrusterLoss;
use super::waves::Waves;
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows};
use crate::task::EpisodeKey;
use crate::task::random::{Purpose, Stream};

/// Declares [`Disturbance`] and [`Places`] of these components, which add to the forcing in this order.
macro_rules! components {
    ($($(#[$doc:meta])* $name:ident: $kind:ty),+ $(,)?) => {
        /// Components of a disturbance; absent ones cost nothing.
        #[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct Disturbance {
            $($(#[$doc])* #[serde(skip_serializing_if = "Option::is_none")] pub $name: Option<$kind>,)+
        }

        impl Disturbance {
            /// Names of the components.
            pub const COMPONENTS: [&'static str; [$(stringify!($name)),+].len()] = [$(stringify!($name)),+];

            /// Refuses numbers out of range, and components that the scene does not allow.
            ///
            /// # Errors
            /// `TaskError::Disturbance`.
            pub fn check(&self, context: &DisturbanceContext) -> Result<(), TaskError> {
                $(self.$name.iter().try_for_each(|component| {
                    component.check_ranges()?;
                    component.check(context)
                })?;)+
                Ok(())
            }

            /// First component of another disturbance that needs rows which this one does not have.
            pub(super) fn lacks(&self, other: &Self) -> Option<&'static str> {
                $(if <$kind>::RESERVED && self.$name.is_none() && other.$name.is_some() {
                    return Some(stringify!($name));
                })+
                None
            }

            /// First size of another disturbance's component above this one's: its option, this size and the other.
            pub(super) fn exceeded(&self, other: &Self) -> Option<(&'static str, usize, usize)> {
                $(
                    let [had, asked] = [self, other].map(|all| all.$name.as_ref().map_or(0, Component::size));
                    if asked > had {
                        return Some((<$kind>::SIZE, had, asked));
                    }
                )+
                None
            }
        }

        /// Rows of the components that have some.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub struct Places {
            $($(#[$doc])* pub $name: Option<Place>,)+
        }

        impl Places {
            /// Allocates rows by `take`, which gives the first of so many.
            pub fn new(
                disturbance: &Disturbance,
                context: &DisturbanceContext,
                mut take: impl FnMut(usize) -> usize,
            ) -> Self {
                Self {
                    $($name: disturbance.$name.as_ref().and_then(|component| {
                        let size = component.size();
                        let rows = <$kind>::rows(size, context);
                        (rows > 0).then(|| Place { row: take(rows), size })
                    }),)+
                }
            }

            /// True where a component has rows.
            pub fn any(&self) -> bool {
                [$(self.$name.is_some()),+].contains(&true)
            }

            /// Draws an episode: see [`Component::begin`].
            pub fn begin<T: Real>(
                &self,
                disturbance: &Disturbance,
                memory: &mut Column<'_, T>,
                key: EpisodeKey,
                context: &DisturbanceContext,
            ) {
                $(if let (Some(at), Some(component)) = (self.$name, &disturbance.$name) {
                    component.begin(memory, at, &Draws { stream: stream::<$kind>(key), step: 0, context });
                })+
            }

            /// Draws what a control period needs: see [`Component::renew`].
            pub fn renew<T: Real>(
                &self,
                memory: &mut Column<'_, T>,
                key: EpisodeKey,
                step: u32,
                context: &DisturbanceContext,
            ) {
                $(if let Some(at) = self.$name {
                    <$kind>::renew(memory, at, &Draws { stream: stream::<$kind>(key), step, context });
                })+
            }

            /// Adds to the forcing: see [`Component::add`].
            #[inline(always)]
            pub fn add<L: Lane>(&self, memory: &Rows<'_, L::Real>, moment: &Moment<'_, L>, forcing: &mut Forcing<L>) {
                $(if let Some(at) = self.$name {
                    <$kind>::add(memory, at, moment, forcing);
                })+
            }

            /// True where a component changes measurements.
            #[inline(always)]
            pub fn measures(&self) -> bool {
                false $(|| (<$kind>::MEASURES && self.$name.is_some()))+
            }

            /// Changes a measurement: see [`Component::measure`].
            #[inline(always)]
            pub fn measure<L: Lane>(
                &self,
                memory: &Rows<'_, L::Real>,
                last: &[L; MEASURED],
                seen: &mut [L; MEASURED],
            ) {
                $(if <$kind>::MEASURES && let Some(at) = self.$name {
                    <$kind>::measure(memory, at, last, seen);
                })+
            }

            /// Ends a control period: see [`Component::end_period`].
            #[inline(always)]
            pub fn end_period<L: Lane>(&self, memory: &mut Rows<'_, L::Real>) {
                $(if let Some(at) = self.$name {
                    <$kind>::end_period::<L>(memory, at);
                })+
            }
        }

        /// Streams have numbers of their own.
        const _: () = {
            let streams = [$(<$kind>::STREAM),+];
            let mut i = 0;
            while i < streams.len() {
                let mut k = 0;
                while k < i {
                    assert!(streams[i] != streams[k] || streams[i] == 0, "two components have the same stream");
                    k += 1;
                }
                i += 1;
            }
        };
    };
}

components! {
    /// Steady current.
    current: SteadyCurrent,
    /// Wandering current.
    drift: Drift,
    /// Gusts.
    gust: Gust,
    /// Time series.
    script: Script,
    /// Waves.
    waves: Waves,
    /// Pushes.
    impulse: Impulse,
    /// Tether.
    tether: Tether,
    /// Payload.
    payload: Payload,
    /// Thrusters with reduced thrust.
    thrusters: ThrusterLoss,
    /// Battery of the thrusters.
    battery: Battery,
    /// Motion of the arm.
    arm: ArmMotion,
    /// Noise of sensors.
    noise: Noise,
    /// Outliers of the measured pose.
    outliers: Outliers,
    /// Loss of measurements.
    dropout: Dropout,
    /// Delay of sensors.
    delay: Delay,
    /// Factors on the scene's parameters.
    parameters: Parameters,
}

/// Stream of a component in an episode.
fn stream<C: Component>(key: EpisodeKey) -> Stream {
    Stream::new(key, Purpose::of(C::STREAM))
}

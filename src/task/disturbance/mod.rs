//! Disturbances of an episode: currents, waves, pushes, loads, failures, sensors, and errors of parameters.
//!
//! Components are independent of each other, each with ranges that every episode draws from. All draws of an episode are in
//! rows of its memory, so that it continues from them alone. Draws of a control period have their own addresses among the
//! random numbers, so that no instance depends on another.

mod arm;
mod column;
mod context;
pub mod current;
mod draws;
mod impulse;
mod kernel;
mod levels;
mod parameters;
mod payload;
mod profile;
mod read;
mod rows;
mod scene_range;
mod script;
mod sensors;
mod span;
mod tether;
mod thrusters;
mod waves;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::EpisodeKey;
use super::random::{Purpose, Stream};
use crate::error::TaskError;
use crate::system::Factors;
pub use arm::ArmMotion;
pub use column::Column;
pub use context::DisturbanceContext;
pub use current::{Drift, Gust, SteadyCurrent};
pub use impulse::Impulse;
pub use kernel::{DisturbanceKernel, Forcing};
pub use levels::{LEVELS, Level};
pub use parameters::Parameters;
pub use payload::{Payload, PayloadEvent};
pub use profile::Profile;
pub use rows::DisturbanceRows;
pub use scene_range::SceneRange;
pub use script::Script;
pub use sensors::{Delay, MEASURED, Noise, SensorRows};
pub use span::Span;
pub use tether::Tether;
pub use thrusters::ThrusterLoss;
pub use waves::{WaveOrbit, Waves};

/// Components of a disturbance; absent ones cost nothing.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Disturbance {
    /// Steady current.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub current: Option<SteadyCurrent>,
    /// Wandering current.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drift: Option<Drift>,
    /// Gusts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gust: Option<Gust>,
    /// Waves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub waves: Option<Waves>,
    /// Pushes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub impulse: Option<Impulse>,
    /// Tether.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tether: Option<Tether>,
    /// Payload.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub payload: Option<Payload>,
    /// Thrusters with reduced thrust.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub thrusters: Option<ThrusterLoss>,
    /// Motion of the arm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub arm: Option<ArmMotion>,
    /// Noise of sensors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise: Option<Noise>,
    /// Delay of sensors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub delay: Option<Delay>,
    /// Factors on the scene's parameters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parameters: Option<Parameters>,
    /// Time series.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub script: Option<Script>,
}

impl Disturbance {
    /// Only a steady current of up to this speed, m/s.
    pub fn steady(speed: f64) -> Self {
        Self { current: Some(SteadyCurrent::up_to(speed)), ..Self::default() }
    }

    /// Refuses numbers out of range, and components that the scene does not allow.
    pub fn check(&self, context: &DisturbanceContext) -> Result<(), TaskError> {
        self.current.iter().try_for_each(SteadyCurrent::check)?;
        self.drift.iter().try_for_each(Drift::check)?;
        self.gust.iter().try_for_each(Gust::check)?;
        self.waves.iter().try_for_each(Waves::check)?;
        self.impulse.iter().try_for_each(Impulse::check)?;
        self.tether.iter().try_for_each(Tether::check)?;
        self.payload.iter().try_for_each(Payload::check)?;
        self.thrusters.iter().try_for_each(|thrusters| thrusters.check(context))?;
        self.arm.iter().try_for_each(ArmMotion::check)?;
        self.noise.iter().try_for_each(Noise::check)?;
        self.delay.iter().try_for_each(|delay| delay.check(context.period))?;
        self.parameters.iter().try_for_each(Parameters::check)?;
        self.script.iter().try_for_each(Script::check)?;
        let weightless = context.gravity == 0.0;
        if weightless && self.waves.is_some() {
            return span::refuse("waves", "the scene has no gravity, without which there are none".into());
        }
        if weightless && self.payload.as_ref().is_some_and(|payload| payload.mass.is_none()) {
            return span::refuse("payload.share", "the scene has no gravity: give a mass".into());
        }
        Ok(())
    }

    /// Refuses another disturbance with components or sizes beyond the memory of this one.
    pub fn check_room(&self, other: &Self, period: f64) -> Result<(), TaskError> {
        let lacking = [
            ("drift", self.drift.is_none() && other.drift.is_some()),
            ("gust", self.gust.is_none() && other.gust.is_some()),
            ("waves", self.waves.is_none() && other.waves.is_some()),
            ("impulse", self.impulse.is_none() && other.impulse.is_some()),
            ("tether", self.tether.is_none() && other.tether.is_some()),
            ("payload", self.payload.is_none() && other.payload.is_some()),
            ("thrusters", self.thrusters.is_none() && other.thrusters.is_some()),
            ("script", self.script.is_none() && other.script.is_some()),
            ("noise", self.noise.is_none() && other.noise.is_some()),
            ("parameters", !self.varies() && other.parameters.is_some()),
            ("parameters of the scene", other.scene_ranges().is_some_and(|other| self.scene_ranges() != Some(other))),
        ];
        let absent = |key: &str| span::refuse(key, "the environment was made without it: make it with it".into());
        if let Some((key, _)) = lacking.into_iter().find(|(_, lacks)| *lacks) {
            return absent(key);
        }
        if let Some((key, had, asked)) = [
            (
                "waves.trains",
                self.waves.as_ref().map_or(0, |waves| waves.trains),
                other.waves.as_ref().map_or(0, |waves| waves.trains),
            ),
            ("script", self.script.as_ref().map_or(0, Script::len), other.script.as_ref().map_or(0, Script::len)),
        ]
        .into_iter()
        .find(|(_, had, asked)| asked > had)
        {
            return span::refuse(key, format!("{asked}, but the environment was made for at most {had}"));
        }
        let [had, asked] = [self, other].map(|disturbance| disturbance.delay_range(period));
        if had != asked {
            let text = |[minimum, most]: [usize; 2]| match minimum == most {
                true => format!("{minimum}"),
                false => format!("{minimum} to {most}"),
            };
            let hint = match had[0] == had[1] {
                true => format!("{{\"periods\": {}}}", had[0]),
                false => format!("{{\"time\": [{}, {}]}}", had[0] as f64 * period, had[1] as f64 * period),
            };
            let (had, asked) = (text(had), text(asked));
            let hint = format!("give {{\"delay\": {hint}}} besides");
            let reason = format!("{asked} control periods, but the environment was made with {had}: {hint}");
            return span::refuse("delay", reason);
        }
        Ok(())
    }

    /// Minimum and maximum age of the measurements, control periods.
    pub fn delay_range(&self, period: f64) -> [usize; 2] {
        self.delay.as_ref().map_or([0; 2], |delay| delay.range(period))
    }

    /// Ranges of numbers of the scene, if there are any.
    fn scene_ranges(&self) -> Option<&BTreeMap<String, SceneRange>> {
        self.parameters.as_ref().map(Parameters::scene).filter(|scene| !scene.is_empty())
    }

    /// True where instances differ in their parameters, now or later.
    pub fn varies(&self) -> bool {
        self.parameters.is_some() || self.payload.is_some()
    }

    /// Factors on the scene's parameters in an episode.
    pub fn factors(&self, key: EpisodeKey) -> Factors<f64> {
        let parameters = self.parameters.as_ref();
        parameters.map_or(Factors::ONE, |parameters| parameters.draw(&Stream::new(key, Purpose::Parameters)))
    }
}

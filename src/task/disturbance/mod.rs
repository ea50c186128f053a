//! Disturbances of an episode: currents, waves, pushes, loads, failures, sensors, and errors of parameters.
//!
//! Components are independent of each other, each with ranges that every episode draws from. All draws of an episode are in
//! rows of its memory, so that it continues from these rows. Draws of a control period have their own addresses among the
//! random numbers, so that no instance depends on another.

mod arm;
mod battery;
mod column;
mod component;
mod components;
mod context;
pub mod current;
mod dropout;
mod impulse;
mod kernel;
mod levels;
mod outliers;
mod parameters;
mod payload;
mod profile;
mod read;
mod scene_range;
mod script;
mod sensors;
mod span;
mod tether;
mod thrusters;
mod waves;

use std::collections::BTreeMap;

use super::EpisodeKey;
use super::random::{Purpose, Stream};
use crate::error::TaskError;
use crate::system::Factors;
pub use arm::ArmMotion;
pub use battery::Battery;
pub use column::Column;
pub use component::{Component, Forcing, Moment, Place};
pub use components::{Disturbance, Places};
pub use context::DisturbanceContext;
pub use current::{Drift, Gust, SteadyCurrent};
pub use dropout::Dropout;
pub use impulse::Impulse;
pub use kernel::{DisturbanceKernel, DisturbanceRows};
pub use levels::{LEVELS, Level};
pub use outliers::Outliers;
pub use parameters::Parameters;
pub use payload::{Payload, PayloadEvent, grasp_impulse};
pub use profile::Profile;
pub use scene_range::SceneRange;
pub use script::Script;
pub use sensors::{Delay, MEASURED, Noise, SensorRows};
pub use span::Span;
pub use tether::Tether;
pub use thrusters::ThrusterLoss;
pub use waves::{WaveOrbit, Waves};

impl Disturbance {
    /// Only a steady current of up to this speed, m/s.
    pub fn steady(speed: f64) -> Self {
        Self { current: Some(SteadyCurrent::up_to(speed)), ..Self::default() }
    }

    /// Refuses another disturbance with components or sizes beyond the memory of this one.
    pub fn check_room(&self, other: &Self, period: f64) -> Result<(), TaskError> {
        let lacking = self.lacks(other).or_else(|| {
            let differs = other.scene_ranges().is_some_and(|other| self.scene_ranges() != Some(other));
            match (!self.varies() && other.parameters.is_some(), differs) {
                (true, _) => Some("parameters"),
                (false, true) => Some("parameters of the scene"),
                (false, false) => None,
            }
        });
        if let Some(key) = lacking {
            return span::refuse(key, "the environment was made without it: make it with it".into());
        }
        if let Some((key, had, asked)) = self.exceeded(other) {
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
        parameters
            .map_or(Factors::ONE, |parameters| parameters.draw(&Stream::new(key, Purpose::of(Parameters::STREAM))))
    }
}

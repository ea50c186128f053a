//! Factors on a scene's parameters, and ranges of its numbers.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::component::{Component, Ranges};
use super::scene_range::SceneRange;
use super::span::{Bounded, Span};
use crate::error::TaskError;
use crate::system::{FACTORS, Factors};
use crate::task::random::Stream;

/// Domain randomisation: factors on the scene's parameters, the same for all bodies of an instance, drawn per episode.
///
/// Volume follows mass, so that a floating body still floats: the factor on the displaced volume is that on mass times `volume`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "Given", into = "BTreeMap<String, SceneRange>")]
pub struct Parameters {
    /// Ranges in the order of [`Factors::NAMES`]; the payload is a mass, kg.
    ranges: [Option<Span>; FACTORS],
    /// Ranges of numbers by their keys in the scene, which have a dot.
    scene: BTreeMap<String, SceneRange>,
}

/// Range for `true`: factors from 0.7 to 1.3.
const USUAL: f64 = 0.3;
/// Parameters randomised by a single number.
const SHARED: [&str; 6] = ["mass", "added_mass", "linear_damping", "quadratic_damping", "thrust", "thruster_lag"];
const PAYLOAD: &str = "payload";
const VOLUME: &str = "volume";
const MASS: &str = "mass";

#[derive(Deserialize)]
#[serde(untagged, expecting = "must be true, a share, or ranges by the name of the parameter")]
enum Given {
    Whether(bool),
    Share(f64),
    Each(BTreeMap<String, SceneRange>),
}

impl TryFrom<Given> for Parameters {
    type Error = String;

    fn try_from(given: Given) -> Result<Self, String> {
        let around = |share: f64| Span::of(1.0 - share, 1.0 + share);
        let mut ranges = [None; FACTORS];
        let mut scene = BTreeMap::new();
        let mut set = |name: &str, span| match place(name) {
            Some(k) => {
                ranges[k] = Some(span);
                Ok(())
            }
            None => {
                let known = Factors::<f64>::NAMES.join(", ");
                Err(format!("unknown parameter `{name}`, expected one of {known}, or a key of the scene with a dot"))
            }
        };
        match given {
            Given::Whether(false) => {}
            Given::Whether(true) => SHARED.iter().try_for_each(|name| set(name, around(USUAL)))?,
            Given::Share(share) => SHARED.iter().try_for_each(|name| set(name, around(share)))?,
            Given::Each(each) => each.into_iter().try_for_each(|(name, range)| {
                let span = match range {
                    _ if name.contains('.') => {
                        scene.insert(name, range);
                        return Ok(());
                    }
                    SceneRange::Share(mass) if name == PAYLOAD => Span::of(0.0, mass),
                    SceneRange::Share(share) => around(share),
                    SceneRange::Number([low, high]) => Span::of(low, high),
                    SceneRange::List(_) => {
                        return Err(format!(
                            "`{name}` must be a share either way, or a list of two, [minimum, maximum]"
                        ));
                    }
                };
                set(&name, span)
            })?,
        }
        Ok(Self { ranges, scene })
    }
}

impl From<Parameters> for BTreeMap<String, SceneRange> {
    fn from(parameters: Parameters) -> Self {
        let names = Factors::<f64>::NAMES.into_iter().map(str::to_owned);
        let factors = names.zip(parameters.ranges);
        let factors = factors.filter_map(|(name, range)| Some((name, SceneRange::Number(range?.into()))));
        factors.chain(parameters.scene).collect()
    }
}

fn place(name: &str) -> Option<usize> {
    Factors::<f64>::NAMES.iter().position(|known| *known == name)
}

impl Parameters {
    /// These ranges, or none if all are empty.
    pub fn any(&self) -> Option<Self> {
        (self.ranges.iter().any(Option::is_some) || !self.scene.is_empty()).then(|| self.clone())
    }

    /// Ranges of numbers by their keys in the scene.
    pub fn scene(&self) -> &BTreeMap<String, SceneRange> {
        &self.scene
    }

    /// Ranges of this share either way, for all but volume and payload.
    pub(super) fn within(share: f64) -> Self {
        Self::try_from(Given::Share(share)).unwrap_or_default()
    }

    /// Factors of an episode.
    pub(super) fn draw(&self, draw: &Stream) -> Factors<f64> {
        let mut factors = Factors::ONE.to_array();
        for (k, range) in self.ranges.iter().enumerate() {
            if let Some(range) = range {
                factors[k] = range.at(draw.uniform(k as u32));
            }
        }
        if let (Some(volume), Some(mass)) = (place(VOLUME), place(MASS)) {
            factors[volume] *= factors[mass];
        }
        Factors::from_array(factors)
    }
}

impl Component for Parameters {
    const STREAM: u32 = 40;
    const RESERVED: bool = false;
}

impl Ranges for Parameters {
    fn check_ranges(&self) -> Result<(), TaskError> {
        for (name, range) in Factors::<f64>::NAMES.into_iter().zip(self.ranges) {
            let (minimum, most) = match name {
                PAYLOAD => (0.0, 1e6),
                MASS => (0.1, 10.0),
                _ => (0.0, 10.0),
            };
            if let Some(range) = range {
                range.low.check(&format!("parameters.{name}"), minimum, most)?;
                range.check(&format!("parameters.{name}"), minimum, most)?;
            }
        }
        Ok(())
    }
}

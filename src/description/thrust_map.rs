//! Static maps from command to thrust.

use serde::{Deserialize, Serialize, Serializer};

/// Steady thrust of a command in still water, before the thruster's limits.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "Given")]
pub enum ThrustMap {
    /// `"t200"`: Blue Robotics' T200 with a pulse width linear in the command, as in common autopilots: 1500 us at command 0, 1887
    /// us (60 N) at the upper limit, 1134 us (-40 N) at the lower one. Pulses of 1470 to 1530 us are the dead band.
    T200,
    /// Pairs `[command, thrust]`, N, interpolated linearly and constant beyond the ends: commands ascend, thrusts never descend,
    /// and `[0, 0]` is one of the pairs.
    Points(Vec<[f64; 2]>),
}

/// Name of [`ThrustMap::T200`] in scenes.
const T200: &str = "t200";

impl Serialize for ThrustMap {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        match self {
            ThrustMap::T200 => T200.serialize(s),
            ThrustMap::Points(points) => points.serialize(s),
        }
    }
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected \"t200\" or pairs [command, thrust]")]
enum Given {
    Name(String),
    Points(Vec<Vec<f64>>),
}

impl TryFrom<Given> for ThrustMap {
    type Error = String;

    fn try_from(given: Given) -> Result<Self, String> {
        let pair = |pair: Vec<f64>| {
            pair.try_into().map_err(|pair: Vec<f64>| format!("expected pairs, found {} numbers", pair.len()))
        };
        match given {
            Given::Name(name) if name == T200 => Ok(Self::T200),
            Given::Name(_) => Err(format!("expected \"{T200}\" or pairs [command, thrust]")),
            Given::Points(points) => points.into_iter().map(pair).collect::<Result<_, _>>().map(Self::Points),
        }
    }
}

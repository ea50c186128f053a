//! Static maps from command to thrust.

use std::borrow::Cow;

use serde::{Deserialize, Serialize, Serializer};

use super::ThrustTable;

/// Steady thrust of a command in still water, before the thruster's limits.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "Given")]
pub enum ThrustMap {
    /// `"t200"`: [`ThrustTable::t200`].
    T200,
    /// Bench table at the vehicle's supply voltage, with a pulse width linear in the command: the neutral one at command 0, the last
    /// one at the upper limit, the first one at the lower limit.
    Table(ThrustTable),
    /// Pairs `[command, thrust]`, N, interpolated linearly and constant beyond the ends: commands ascend, thrusts never descend,
    /// and `[0, 0]` is one of the pairs.
    Points(Vec<[f64; 2]>),
}

/// Name of [`ThrustMap::T200`] in scenes.
const T200: &str = "t200";

impl ThrustMap {
    /// Its table, unless the map is given by pairs.
    pub fn table(&self) -> Option<&ThrustTable> {
        match self {
            Self::T200 => Some(ThrustTable::t200()),
            Self::Table(table) => Some(table),
            Self::Points(_) => None,
        }
    }

    /// Pairs `[command, thrust]` of a thruster with these limits (N) at a supply voltage (V).
    pub fn points(&self, limits: [f64; 2], voltage: f64) -> Cow<'_, [[f64; 2]]> {
        match self {
            Self::Points(points) => Cow::Borrowed(points),
            _ => Cow::Owned(self.table().map_or_else(Vec::new, |table| table.points(limits, voltage))),
        }
    }
}

impl Serialize for ThrustMap {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        match self {
            ThrustMap::T200 => T200.serialize(s),
            ThrustMap::Table(table) => table.serialize(s),
            ThrustMap::Points(points) => points.serialize(s),
        }
    }
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected \"t200\", a table of pulses, voltages and thrusts, or pairs [command, thrust]")]
enum Given {
    Name(String),
    Table(ThrustTable),
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
            Given::Name(name) => {
                Err(format!("no map is named \"{name}\": expected \"{T200}\", a table, or pairs [command, thrust]"))
            }
            Given::Table(table) => table.check().map(|()| Self::Table(table)),
            Given::Points(points) => points.into_iter().map(pair).collect::<Result<_, _>>().map(Self::Points),
        }
    }
}

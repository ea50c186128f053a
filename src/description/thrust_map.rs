//! Static maps from command to thrust.

use std::fmt;

use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Steady thrust of a command in still water, before the thruster's limits.
#[derive(Debug, Clone, PartialEq)]
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

impl<'de> Deserialize<'de> for ThrustMap {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct MapVisitor;
        impl<'de> Visitor<'de> for MapVisitor {
            type Value = ThrustMap;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("\"t200\" or pairs [command, thrust]")
            }

            fn visit_str<E: Error>(self, name: &str) -> Result<ThrustMap, E> {
                if name == T200 {
                    Ok(ThrustMap::T200)
                } else {
                    Err(E::custom("expected \"t200\" or pairs [command, thrust]"))
                }
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<ThrustMap, A::Error> {
                let mut points = Vec::new();
                while let Some(pair) = seq.next_element::<Vec<f64>>()? {
                    let found = pair.len();
                    points.push(
                        pair.try_into()
                            .map_err(|_| A::Error::custom(format!("expected pairs, found {found} numbers")))?,
                    );
                }
                Ok(ThrustMap::Points(points))
            }
        }
        d.deserialize_any(MapVisitor)
    }
}

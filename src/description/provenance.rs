//! Provenance of the numbers of a scene.

use std::collections::BTreeMap;

use serde::de::value::{Error, StrDeserializer};
use serde::{Deserialize, Serialize};
use toml::Value;

use super::path::{self, Step};
use crate::error::Problem;
use crate::keys::Fault;

/// Origin of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Origin {
    /// Measured on the robot.
    Measured,
    /// Fitted to logs of the robot.
    Fitted,
    /// Taken from a cited source.
    Cited,
    /// Derived from other numbers (geometry, strip theory).
    Derived,
    /// Assumed: an estimate.
    Assumed,
}

/// Provenance per key of the scene, as `"origin: text"`.
///
/// A key is a path in the scene and holds for everything below it; the longest matching key counts. `arm.links.body.mass` is the
/// mass of every link, `arm.links[elbow].body.mass` (or `[2]`) the mass of one.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Provenance(pub BTreeMap<String, String>);

/// Splits `"cited: a book"`.
fn split(text: &str) -> Option<(Origin, &str)> {
    let (origin, rest) = text.split_once(':')?;
    let origin = Origin::deserialize(StrDeserializer::<Error>::new(origin)).ok()?;
    Some((origin, rest.trim())).filter(|(_, rest)| !rest.is_empty())
}

impl Provenance {
    /// Provenance of the path `steps` in the tree `root`.
    pub(super) fn lookup(&self, root: &Value, steps: &[Step]) -> Option<(Origin, &str)> {
        self.text(root, steps).and_then(split)
    }

    /// Provenance of the path `steps`, as it is stated.
    pub(super) fn text(&self, root: &Value, steps: &[Step]) -> Option<&str> {
        let matching =
            self.0.iter().filter_map(|(key, text)| Some((path::coverage(&path::parse(key), steps, root)?, text)));
        matching.max_by_key(|(coverage, _)| *coverage).map(|(_, text)| text.as_str())
    }

    /// Removes entries whose keys match nothing.
    pub(super) fn prune(&mut self, root: &Value) {
        self.0.retain(|key, _| path::matches_anything(&path::parse(key), root));
    }

    /// Refuses texts of unknown origin and keys that match nothing.
    pub(super) fn check(&self, root: &Value) -> Result<(), Fault> {
        for (key, text) in &self.0 {
            let fault = |problem| Err(Fault::new(format!("provenance.\"{key}\""), problem));
            if split(text).is_none() {
                return fault(Problem::Provenance { text: text.clone() });
            }
            if !path::matches_anything(&path::parse(key), root) {
                return fault(Problem::ProvenanceOfNothing { text: text.clone() });
            }
        }
        Ok(())
    }
}

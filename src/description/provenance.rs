//! Where each number of a scene comes from.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Origin of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Origin {
    /// Measured on the device.
    Measured,
    /// Taken from a cited source.
    Cited,
    /// Derived from other numbers (geometry, strip theory).
    Derived,
    /// Assumed: an estimate.
    Assumed,
}

/// Provenance per key of the scene.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Provenance(pub BTreeMap<String, String>);

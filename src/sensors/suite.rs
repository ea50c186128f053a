//! Sensors of a vehicle by name, from JSON.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::sensor::Sensor;
use super::{Acoustic, Depth, Dvl, Heading, Imu};
use crate::error::SensorError;
use crate::keys::read_tree;

/// Declares the suite: one line for each sensor.
macro_rules! suite {
    ($($(#[$doc:meta])* $name:ident: $kind:ty,)*) => {
        /// Settings of the sensors on a vehicle; absent ones are not fitted.
        #[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct Suite {
            $($(#[$doc])* #[serde(skip_serializing_if = "Option::is_none")] pub $name: Option<$kind>,)*
        }

        impl Suite {
            /// Names of all sensors.
            pub const NAMES: &'static [&'static str] = &[$(stringify!($name)),*];

            /// All sensors with their defaults.
            pub fn all() -> Self {
                Self { $($name: Some(<$kind>::default()),)* }
            }

            /// Sensors that are fitted.
            pub fn sensors(&self) -> Vec<Box<dyn Sensor>> {
                let mut list: Vec<Box<dyn Sensor>> = Vec::new();
                $(if let Some(sensor) = &self.$name { list.push(Box::new(sensor.clone())); })*
                list
            }
        }
    };
}

suite! {
    /// Inertial measurement unit.
    imu: Imu,
    /// Doppler velocity log.
    dvl: Dvl,
    /// Pressure sensor.
    depth: Depth,
    /// Compass.
    heading: Heading,
    /// Acoustic position fixes.
    acoustic: Acoustic,
}

/// Refusal of a key.
fn refuse<T>(key: &str, reason: String) -> Result<T, SensorError> {
    Err(SensorError::Suite { key: key.into(), reason })
}

impl Suite {
    /// Place of a sensor in the list.
    pub(super) fn place(name: &str) -> usize {
        Self::NAMES.iter().position(|known| *known == name).unwrap_or(Self::NAMES.len())
    }

    /// From JSON: `null` for all sensors, a list of names, or an object of settings by name, where `true` has the defaults
    /// and `null` or `false` leaves a sensor out.
    ///
    /// # Errors
    /// [`SensorError::Suite`] for unknown names and keys and for numbers out of range.
    pub fn from_json(text: &str) -> Result<Self, SensorError> {
        let given = match serde_json::from_str(text) {
            Ok(value) => value,
            Err(error) => return refuse("suite", error.to_string()),
        };
        let suite = match given {
            Value::Null => Self::all(),
            Value::Array(names) => {
                let entries = names.into_iter().map(|name| match name {
                    Value::String(name) => Ok((name, Value::Bool(true))),
                    other => refuse("suite", format!("must be a list of names, not of {other}")),
                });
                Self::of(entries.collect::<Result<_, _>>()?)?
            }
            Value::Object(object) => Self::of(object)?,
            other => return refuse("suite", format!("must be a dict of sensors or a list of names, not {other}")),
        };
        suite.sensors().iter().try_for_each(|sensor| sensor.check())?;
        Ok(suite)
    }

    fn of(given: Map<String, Value>) -> Result<Self, SensorError> {
        let mut fitted = Map::new();
        for (name, settings) in given {
            if !Self::NAMES.contains(&name.as_str()) {
                return refuse("suite", format!("unknown sensor '{name}'; known: {}", Self::NAMES.join(", ")));
            }
            match settings {
                Value::Null | Value::Bool(false) => {}
                Value::Bool(true) => drop(fitted.insert(name, Value::Object(Map::new()))),
                other => drop(fitted.insert(name, other)),
            }
        }
        read_tree(Value::Object(fitted)).map_err(|error| SensorError::Suite { key: error.place, reason: error.message })
    }

    /// JSON for [`Self::from_json`].
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }
}

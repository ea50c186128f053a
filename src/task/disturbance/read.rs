//! Disturbances from names and JSON.

use serde_json::{Map, Value};

use super::span::refuse;
use super::{Disturbance, LEVELS, Level};
use crate::error::TaskError;
use crate::keys::read_tree;

/// Key of a dict's base level.
const BASE: &str = "base";

impl Disturbance {
    /// The level of that name.
    ///
    /// # Errors
    /// `TaskError::Disturbance` for an unknown name; it lists the known ones.
    pub fn named(name: &str) -> Result<Self, TaskError> {
        match LEVELS.iter().find(|level| level.name == name) {
            Some(level) => Ok(level.disturbance()),
            None => {
                let known: Vec<_> = LEVELS.iter().map(|Level { name, .. }| *name).collect();
                refuse("disturbance", format!("there is no level '{name}'; known: {}", known.join(", ")))
            }
        }
    }

    /// From JSON: the name of a level, or an object of components by name. Its key `base` names the level to change
    /// (`"calm"` by default): given keys of a component replace the level's, `null` or `false` removes the
    /// component, and `true` sets its defaults.
    ///
    /// # Errors
    /// `TaskError::Disturbance` for other text; unknown keys are named, with the known ones.
    pub fn from_json(text: &str) -> Result<Self, TaskError> {
        match serde_json::from_str(text) {
            Ok(value) => Self::from_value(value),
            Err(error) => refuse("disturbance", error.to_string()),
        }
    }

    fn from_value(value: Value) -> Result<Self, TaskError> {
        match value {
            Value::String(name) => Self::named(&name),
            Value::Object(given) => Self::from_object(given),
            other => refuse("disturbance", format!("must be the name of a level or a dict of components, not {other}")),
        }
    }

    fn from_object(mut given: Map<String, Value>) -> Result<Self, TaskError> {
        let base = match given.remove(BASE) {
            None => Self::default(),
            Some(Value::String(name)) => Self::named(&name)?,
            Some(other) => return refuse(BASE, format!("must be the name of a level, not {other}")),
        };
        base.changed(given)
    }

    /// With components changed by an object of components by name: see [`Self::from_json`].
    pub(super) fn changed(self, given: Map<String, Value>) -> Result<Self, TaskError> {
        let Ok(Value::Object(mut components)) = serde_json::to_value(self) else {
            return refuse("disturbance", "not finite".into());
        };
        for (key, component) in given {
            if !Self::COMPONENTS.contains(&key.as_str()) {
                let known = Self::COMPONENTS.join(", ");
                return refuse("disturbance", format!("unknown component '{key}'; known: {known}, and {BASE}"));
            }
            match component {
                Value::Null | Value::Bool(false) => {
                    components.remove(&key);
                }
                // The parameters read `true` themselves.
                Value::Bool(true) if key != "parameters" => {
                    components.entry(key).or_insert_with(|| Value::Object(Map::new()));
                }
                time @ (Value::Number(_) | Value::Array(_)) if key == "delay" => {
                    components.insert(key, Value::Object(Map::from_iter([("time".to_owned(), time)])));
                }
                Value::Object(changes) => {
                    if let Some(Value::Object(there)) = components.get_mut(&key) {
                        there.extend(changes);
                    } else {
                        components.insert(key, Value::Object(changes));
                    }
                }
                other => {
                    components.insert(key, other);
                }
            }
        }
        read_tree(Value::Object(components))
            .map_err(|error| TaskError::Disturbance { key: error.place, reason: error.message })
    }

    /// JSON for [`Self::from_json`].
    pub fn to_json(&self) -> String {
        // Numbers that are not finite would become null.
        serde_json::to_string(self).unwrap_or_default()
    }
}

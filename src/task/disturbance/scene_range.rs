//! Ranges of numbers of the scene.

use serde::{Deserialize, Serialize};
use toml::Value;

/// Range of a number, or of the numbers of a list, at a key of the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "must be a share either way, a list of two, [minimum, maximum], or a list of two lists")]
pub enum SceneRange {
    /// Share of the scene's value either way: a factor for each number of a list, one for all of a matrix.
    Share(f64),
    /// Minimum and maximum number.
    Number([f64; 2]),
    /// Minimum and maximum numbers of a list.
    List([Vec<f64>; 2]),
}

impl SceneRange {
    /// Refuses ranges without numbers or order, and of another form than the scene's value.
    pub fn check(&self, value: &Value) -> Result<(), String> {
        let ordered = |low: f64, high: f64| {
            let ordered = low <= high && low.is_finite() && high.is_finite();
            if ordered { Ok(()) } else { Err(format!("[{low}, {high}] is no range, minimum first")) }
        };
        match (self, value) {
            (Self::Share(share), _) if !(0.0..1.0).contains(share) => {
                Err(format!("the share {share} must be in [0, 1)"))
            }
            (Self::Share(_), value) if *value == times(value, 2.0) => Err("the value is 0: give a range".into()),
            (Self::Share(_), _) => Ok(()),
            (Self::Number([low, high]), Value::Float(_) | Value::Integer(_)) => ordered(*low, *high),
            (Self::List([low, high]), Value::Array(list)) if low.len() == list.len() && high.len() == list.len() => {
                low.iter().zip(high).try_for_each(|(low, high)| ordered(*low, *high))
            }
            (_, Value::Array(list)) => {
                Err(format!("the value is a list of {0}: give a share or two lists of {0}", list.len()))
            }
            _ => Err("the value is a number: give a share or a list of two, [minimum, maximum]".into()),
        }
    }

    /// Zeros in the form of the range, for keys that the scene leaves out; none of a share.
    pub fn zeros(&self) -> Option<Value> {
        match self {
            Self::Share(_) => None,
            Self::Number(_) => Some(Value::Float(0.0)),
            Self::List([low, _]) => Some(Value::Array(vec![Value::Float(0.0); low.len()])),
        }
    }

    /// A value in the range, around the scene's; `uniform` draws from [0, 1).
    pub fn draw(&self, value: &Value, uniform: &mut dyn FnMut() -> f64) -> Value {
        let mut between = |low: f64, high: f64| low + (high - low) * uniform();
        match (self, value) {
            (Self::Number([low, high]), _) => Value::Float(between(*low, *high)),
            (Self::List([low, high]), _) => {
                Value::Array(low.iter().zip(high).map(|(low, high)| Value::Float(between(*low, *high))).collect())
            }
            (Self::Share(share), Value::Array(list)) if !list.iter().any(Value::is_array) => {
                Value::Array(list.iter().map(|x| times(x, between(1.0 - share, 1.0 + share))).collect())
            }
            (Self::Share(share), _) => times(value, between(1.0 - share, 1.0 + share)),
        }
    }
}

/// Every number of a value times a factor.
fn times(value: &Value, factor: f64) -> Value {
    match value {
        Value::Float(x) => Value::Float(x * factor),
        Value::Integer(x) => Value::Float(*x as f64 * factor),
        Value::Array(list) => Value::Array(list.iter().map(|x| times(x, factor)).collect()),
        other => other.clone(),
    }
}

//! Gains of controllers as data: structs that are read, changed and checked by name.

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use crate::error::ControlError;

/// Maximum age of measurements, control periods, of sensors and in an observer.
pub const MAX_SENSOR_DELAY: usize = 100;
/// Maximum age of measurements that banks of models and plans bridge, control periods.
pub const MAX_DELAY: usize = 10;
/// Maximum time beyond the present for which a model predicts, s.
const MAX_HORIZON: f64 = 10.0;

/// Gains by name: numbers and lists of numbers; null for a gain that is not given.
pub type GainMap = Map<String, Value>;

/// A gain as a value of a [`GainMap`]: a list of numbers, or one.
///
/// # Errors
/// `ControlError::Gain` for a number that is not finite, which JSON cannot represent.
pub fn gain_value(name: &str, numbers: &[f64], list: bool) -> Result<Value, ControlError> {
    if let Some((index, &value)) = numbers.iter().enumerate().find(|(_, k)| !k.is_finite()) {
        return Err(ControlError::Gain { name: name.to_owned(), index, value });
    }
    Ok(if list { numbers.into() } else { numbers.first().copied().into() })
}

/// Gains by name.
pub(super) fn to_map(gains: &impl Serialize) -> GainMap {
    match serde_json::to_value(gains) {
        Ok(Value::Object(map)) => map,
        _ => unreachable!("gains are structs of numbers"),
    }
}

/// Names of gains.
pub fn gain_names(gains: &impl Serialize) -> Vec<String> {
    to_map(gains).into_iter().map(|(name, _)| name).collect()
}

/// Refuses gains that are not finite or are negative.
pub(super) fn check(gains: &impl Serialize) -> Result<(), ControlError> {
    for (name, value) in to_map(gains) {
        let numbers = match value {
            Value::Array(numbers) => numbers,
            number => vec![number],
        };
        for (index, number) in numbers.iter().enumerate() {
            // A number that is not finite has become null.
            let value = number.as_f64().unwrap_or(f64::NAN);
            if value.is_nan() || value < 0.0 {
                return Err(ControlError::Gain { name, index, value });
            }
        }
    }
    Ok(())
}

/// Refuses a delay of measurements beyond a maximum, control periods.
pub(super) fn check_delay(periods: usize, most: usize) -> Result<(), ControlError> {
    if periods > most { Err(ControlError::Delay { periods, most }) } else { Ok(()) }
}

/// Refuses a prediction beyond the present that would take too long.
pub(super) fn check_horizon(time: f64) -> Result<(), ControlError> {
    if time > MAX_HORIZON {
        let (name, value) = ("prediction_horizon".to_owned(), time.to_string());
        return Err(ControlError::GainShape { name, value, expected: format!("at most {MAX_HORIZON} s") });
    }
    Ok(())
}

/// Refuses lists of gains, by name, with a 0.
pub(super) fn check_positive(lists: &[(&str, &[f64])]) -> Result<(), ControlError> {
    match lists.iter().find(|(_, values)| values.contains(&0.0)) {
        Some((name, values)) => {
            let (name, value) = ((*name).to_owned(), format!("{values:?}"));
            Err(ControlError::GainShape { name, value, expected: "above 0".to_owned() })
        }
        None => Ok(()),
    }
}

/// `gains` with the given ones replaced, checked.
///
/// # Errors
/// `ControlError` for an unknown gain, one of another length, or one that is not finite or is negative.
pub fn merge<G: Serialize + DeserializeOwned>(gains: &G, given: &GainMap) -> Result<G, ControlError> {
    let mut all = to_map(gains);
    for (name, value) in given.iter().filter(|(_, value)| !value.is_null()) {
        let Some(old) = all.get_mut(name) else {
            let known = all.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
            return Err(ControlError::UnknownGain { name: name.clone(), known });
        };
        let numbers = |value: &Value| value.as_array().map(Vec::len);
        let integer = old.is_u64() && value.is_f64() && value.as_f64() >= Some(0.0);
        if numbers(old) != numbers(value) || integer {
            let expected = match numbers(old) {
                Some(length) => format!("{length} numbers"),
                None if integer => "a whole number".to_owned(),
                None => "a number".to_owned(),
            };
            return Err(ControlError::GainShape { name: name.clone(), value: value.to_string(), expected });
        }
        old.clone_from(value);
    }
    check(&all)?;
    serde_json::from_value(Value::Object(all)).map_err(|error| ControlError::Model(error.to_string()))
}

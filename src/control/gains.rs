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

/// The one gain that is a list of names.
const HOLD: &str = "hold";

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
pub fn to_map(gains: &impl Serialize) -> GainMap {
    match serde_json::to_value(gains) {
        Ok(Value::Object(map)) => map,
        _ => unreachable!("gains are structs of numbers"),
    }
}

/// Names of gains.
pub fn gain_names(gains: &impl Serialize) -> Vec<String> {
    to_map(gains).into_iter().map(|(name, _)| name).collect()
}

/// Refuses gains that are not finite or are negative, factors and deviations of 0, delays of more than `max_delay` control
/// periods, and predictions beyond the present that would take too long.
fn check(gains: &GainMap, max_delay: usize) -> Result<(), ControlError> {
    for (name, value) in gains.iter().filter(|(name, _)| *name != HOLD) {
        // A number that is not finite has become null.
        let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
        let numbers = value.as_array().map_or_else(|| vec![number(value)], |list| list.iter().map(number).collect());
        if let Some(index) = numbers.iter().position(|x| x.is_nan() || *x < 0.0) {
            return Err(ControlError::Gain { name: name.clone(), index, value: numbers[index] });
        }
        let (value, expected) = match name.as_str() {
            "delay" if numbers[0] > max_delay as f64 => {
                return Err(ControlError::Delay { periods: numbers[0] as usize, most: max_delay });
            }
            "prediction_horizon" if numbers[0] > MAX_HORIZON => {
                (numbers[0].to_string(), format!("at most {MAX_HORIZON} s"))
            }
            "thrust_factors" | "innovation" | "joint_innovation" if numbers.contains(&0.0) => {
                (format!("{numbers:?}"), "above 0".to_owned())
            }
            _ => continue,
        };
        return Err(ControlError::GainShape { name: name.clone(), value, expected });
    }
    Ok(())
}

/// `gains` with the given ones replaced, checked; measurements are at most `max_delay` control periods old.
///
/// # Errors
/// `ControlError` for an unknown gain, or one of another length; for one that is not finite or is negative; for a factor or a
/// deviation of 0, a longer delay, or a prediction horizon beyond 10 s.
pub fn merge<G>(gains: &G, given: &GainMap, max_delay: usize) -> Result<G, ControlError>
where
    G: Serialize + DeserializeOwned,
{
    let mut all = to_map(gains);
    for (name, value) in given.iter().filter(|(_, value)| !value.is_null()) {
        let Some(old) = all.get_mut(name) else {
            let known = all.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
            return Err(ControlError::UnknownGain { name: name.clone(), known });
        };
        let numbers = |value: &Value| value.as_array().map(Vec::len);
        let integer = old.is_u64() && value.is_f64() && value.as_f64() >= Some(0.0);
        let names = |list: &Vec<Value>| list.iter().all(Value::is_string);
        if name == HOLD && !value.as_array().is_some_and(names) {
            let expected = "a list of names of end effectors".to_owned();
            return Err(ControlError::GainShape { name: name.clone(), value: value.to_string(), expected });
        }
        if name != HOLD && (numbers(old) != numbers(value) || integer) {
            let expected = match numbers(old) {
                Some(length) => format!("{length} numbers"),
                None if integer => "a whole number".to_owned(),
                None => "a number".to_owned(),
            };
            return Err(ControlError::GainShape { name: name.clone(), value: value.to_string(), expected });
        }
        old.clone_from(value);
    }
    check(&all, max_delay)?;
    serde_json::from_value(Value::Object(all)).map_err(|error| ControlError::Model(error.to_string()))
}

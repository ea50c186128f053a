//! Named choices of string arguments.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The value that `name` stands for.
pub(super) fn one_of<T, const K: usize>(argument: &str, name: &str, choices: [(&str, T); K]) -> PyResult<T> {
    let known = choices.each_ref().map(|(name, _)| format!("'{name}'")).join(", ");
    let found = choices.into_iter().find(|(choice, _)| *choice == name);
    found
        .map(|(_, value)| value)
        .ok_or_else(|| PyValueError::new_err(format!("{argument} is '{name}', but must be one of {known}")))
}

/// The name of `value`.
pub(super) fn name_of<T: PartialEq, const K: usize>(value: T, choices: [(&'static str, T); K]) -> &'static str {
    choices.into_iter().find(|(_, choice)| *choice == value).expect("every value has a name").0
}

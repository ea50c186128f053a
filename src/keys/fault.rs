//! A problem together with its key, and the common checks.

use nalgebra::Vector3;

use crate::error::Problem;

/// A problem and the path of the key that has it.
#[derive(Debug)]
pub struct Fault {
    /// Path of the key.
    pub key: String,
    /// The problem.
    pub problem: Problem,
}

impl Fault {
    /// A problem of the key.
    pub fn new(key: impl Into<String>, problem: Problem) -> Self {
        Self { key: key.into(), problem }
    }

    /// The fault of a table that stands at this key.
    pub fn below(self, key: &str) -> Self {
        let dot = if self.key.is_empty() || self.key.starts_with('[') { "" } else { "." };
        Self { key: format!("{key}{dot}{}", self.key), ..self }
    }
}

/// A fault unless the number satisfies the rule.
pub fn range(ok: bool, value: f64, rule: &'static str, key: impl FnOnce() -> String) -> Result<(), Fault> {
    if ok { Ok(()) } else { Err(Fault::new(key(), Problem::Range { value, rule })) }
}

/// A fault for the first negative number; their keys are below `key`.
pub fn check_not_negative<const K: usize>(key: &str, numbers: [(&str, f64); K]) -> Result<(), Fault> {
    numbers.into_iter().try_for_each(|(name, x)| range(x >= 0.0, x, ">= 0", || format!("{key}.{name}")))
}

/// A fault for an axis without direction.
pub fn check_axis(axis: &Vector3<f64>, key: impl FnOnce() -> String) -> Result<(), Fault> {
    if axis.norm() > 1e-9 { Ok(()) } else { Err(Fault::new(key(), Problem::ZeroAxis { axis: (*axis).into() })) }
}

/// The fault of a name that is none of the `of`, whose names are `known`.
pub fn none_of<'a>(
    value: &str,
    of: &'static str,
    known: impl Iterator<Item = &'a str>,
    key: impl Into<String>,
) -> Fault {
    let expected = known.map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
    Fault::new(key, Problem::NoneOf { value: value.to_owned(), of, expected })
}

/// Checks names in a list: not empty, without brackets (part of the syntax of keys), unique.
pub fn check_names<'a>(list: impl Iterator<Item = &'a str>, reserved: &[&str], key: &str) -> Result<(), Fault> {
    let mut seen = Vec::new();
    for (i, name) in list.enumerate() {
        let reason = match name {
            "" => Some("empty"),
            _ if name.contains(['[', ']']) => Some("invalid: brackets are part of the syntax of keys"),
            _ if reserved.contains(&name) => Some("reserved"),
            _ if seen.contains(&name) => Some("taken by an earlier element"),
            _ => None,
        };
        if let Some(reason) = reason {
            let problem = Problem::Name { name: name.to_owned(), reason };
            return Err(Fault::new(format!("{key}[{i}].name"), problem));
        }
        seen.push(name);
    }
    Ok(())
}

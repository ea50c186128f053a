//! A problem together with its key.

use toml::Value;

use super::path;
use crate::error::{DescriptionError, Problem};

/// A problem and the path of the key that has it.
#[derive(Debug)]
pub struct Fault {
    pub key: String,
    pub problem: Problem,
}

impl Fault {
    pub fn new(key: impl Into<String>, problem: Problem) -> Self {
        Self { key: key.into(), problem }
    }

    /// The error of a tree of values from this source.
    pub fn in_source(self, source_name: impl Into<String>, root: &Value) -> DescriptionError {
        let key = path::with_names(root, &self.key);
        DescriptionError::Value { source_name: source_name.into(), key, problem: self.problem }
    }
}

/// A fault unless the number satisfies the rule.
pub fn range(ok: bool, value: f64, rule: &'static str, key: impl FnOnce() -> String) -> Result<(), Fault> {
    if ok { Ok(()) } else { Err(Fault::new(key(), Problem::Range { value, rule })) }
}

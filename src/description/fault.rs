//! The error of a fault in a scene.

use toml::Value;

use super::path;
use crate::error::DescriptionError;
use crate::keys::Fault;

impl Fault {
    /// The error of a tree of values from this source.
    pub fn in_source(self, source_name: impl Into<String>, root: &Value) -> DescriptionError {
        let key = path::with_names(root, &self.key);
        DescriptionError::Value { source_name: source_name.into(), key, problem: self.problem }
    }
}

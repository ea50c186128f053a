//! Errors of memory.

/// Arrays that do not fit into memory.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("not enough memory for {what}: {gigabytes:.1} GB are needed")]
pub struct OutOfMemory {
    pub what: &'static str,
    pub gigabytes: f64,
}

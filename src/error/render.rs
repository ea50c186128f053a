//! Errors of the renderer.

/// Invalid setting of a renderer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// Picture that is empty or too large.
    #[error("{what} is {got}, but must be 1 to {most}")]
    Size {
        /// Width or height.
        what: &'static str,
        /// Value.
        got: usize,
        /// Greatest value allowed.
        most: usize,
    },
    /// Setting that is out of range or not finite.
    #[error("{what} is {value}, but must be {rule}")]
    Setting {
        /// Name of the setting.
        what: &'static str,
        /// Value.
        value: f64,
        /// Rule that it breaks.
        rule: &'static str,
    },
}

//! Errors of the renderer.

/// Invalid setting of a renderer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// Picture that is empty or too large.
    #[error("{what} is {got}, but must be 1 to {most}")]
    Size { what: &'static str, got: usize, most: usize },
    /// Setting that is out of range or not finite.
    #[error("{what} is {value}, but must be {rule}")]
    Setting { what: &'static str, value: f64, rule: &'static str },
}

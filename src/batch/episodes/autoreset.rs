//! Handling of episodes that are over.

/// Handling of instances whose episode is over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Autoreset {
    /// The next step ignores the action and starts the next episode: its first observation, reward 0.
    #[default]
    NextStep,
    /// The same step starts the next episode; the last observation and metrics are in [`Transition::finals`](super::Transition::finals).
    SameStep,
    /// The instance waits for [`TaskBatch::reset`](super::TaskBatch::reset).
    Disabled,
}

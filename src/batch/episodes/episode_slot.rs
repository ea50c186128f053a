//! Episode of an instance.

use crate::error::TaskError;
use crate::task::{Episode, EpisodeKey, EpisodeRows};

/// Current episode of an instance; before the first, the key of that one.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct EpisodeSlot {
    pub key: EpisodeKey,
    /// Completed control periods.
    pub step: u32,
    /// An episode has begun.
    pub begun: bool,
    /// The episode is over.
    pub over: bool,
}

impl EpisodeSlot {
    /// At the start of an episode.
    pub fn of(key: EpisodeKey) -> Self {
        Self { key, step: 0, begun: true, over: false }
    }

    /// Before the first episode.
    pub fn before(key: EpisodeKey) -> Self {
        Self { key, ..Self::default() }
    }

    /// Key of the next episode.
    pub fn next(&self) -> EpisodeKey {
        if self.begun { self.key.following() } else { self.key }
    }

    /// The slot and its episode as plain numbers.
    pub fn to_numbers(&self, episode: &Episode) -> Vec<f64> {
        let flags = [self.over, self.begun].map(|flag| f64::from(u8::from(flag)));
        flags.into_iter().chain(episode.to_numbers()).collect()
    }

    /// Count of these numbers.
    pub fn width(rows: EpisodeRows) -> usize {
        Self::default().to_numbers(&Episode::blank(EpisodeKey::default(), rows)).len()
    }

    /// Slot and episode of [`Self::to_numbers`].
    pub fn from_numbers(rows: EpisodeRows, numbers: &[f64]) -> Result<(Self, Episode), TaskError> {
        let flag = |x: f64| match x {
            0.0 => Ok(false),
            1.0 => Ok(true),
            _ => Err(TaskError::Saved(format!("{x} is not a count of 0 or 1"))),
        };
        let (over, begun, episode) =
            (flag(numbers[0])?, flag(numbers[1])?, Episode::from_numbers(rows, &numbers[2..])?);
        Ok((Self { key: episode.key(), step: episode.step(), begun, over }, episode))
    }
}

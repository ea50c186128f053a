//! Current and next episode of an instance.

use crate::error::TaskError;
use crate::task::{Episode, EpisodeKey, EpisodeRows};

/// Current episode of an instance, and the key of the next one.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct EpisodeSlot {
    pub next: EpisodeKey,
    pub key: EpisodeKey,
    /// Completed control periods.
    pub step: u32,
    /// An episode has begun.
    pub begun: bool,
    /// The episode is over.
    pub over: bool,
}

impl EpisodeSlot {
    /// Count of the numbers before the episode's numbers.
    const HEAD: usize = 6;

    /// At the start of an episode.
    pub fn of(key: EpisodeKey) -> Self {
        Self { next: key.following(), key, step: 0, begun: true, over: false }
    }

    /// Before the first episode.
    pub fn before(next: EpisodeKey) -> Self {
        Self { next, key: next, ..Self::default() }
    }

    /// The slot and its episode as plain numbers.
    pub fn to_numbers(&self, episode: &Episode) -> Vec<f64> {
        let EpisodeKey { seed, episode: number } = self.next;
        let halves = |x: u64| [f64::from(x as u32), f64::from((x >> 32) as u32)];
        let flags = [f64::from(u8::from(self.over)), f64::from(u8::from(self.begun))];
        [halves(seed), halves(number), flags].concat().into_iter().chain(episode.to_numbers()).collect()
    }

    /// Count of these numbers.
    pub fn width(rows: EpisodeRows) -> usize {
        Self::HEAD + Episode::blank(EpisodeKey::default(), rows).to_numbers().len()
    }

    /// Slot and episode of [`Self::to_numbers`].
    pub fn from_numbers(rows: EpisodeRows, numbers: &[f64]) -> Result<(Self, Episode), TaskError> {
        let (head, episode) = numbers.split_at(Self::HEAD);
        let integer = |k: usize| {
            let n = head[k] as u32;
            if f64::from(n) == head[k] { Ok(n) } else { Err(TaskError::Saved(format!("{} is not a count", head[k]))) }
        };
        let join = |k: usize| Ok::<u64, TaskError>(u64::from(integer(k)?) | u64::from(integer(k + 1)?) << 32);
        let episode = Episode::from_numbers(rows, episode)?;
        let slot = Self {
            next: EpisodeKey { seed: join(0)?, episode: join(2)? },
            key: episode.key(),
            step: episode.step(),
            over: integer(4)? != 0,
            begun: integer(5)? != 0,
        };
        Ok((slot, episode))
    }
}

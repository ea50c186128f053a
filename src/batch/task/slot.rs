//! Which episode an instance is in, and which comes after it.

use crate::error::TaskError;
use crate::task::{Episode, EpisodeKey, EpisodeRows};

/// One instance's place: the episode that runs, and the address of the one after it.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Slot {
    pub next: EpisodeKey,
    pub key: EpisodeKey,
    /// Control periods done.
    pub step: u32,
    /// Whether there is an episode at all.
    pub begun: bool,
    pub over: bool,
}

impl Slot {
    /// Numbers before those of the episode.
    const HEAD: usize = 6;

    /// At the start of an episode.
    pub fn of(key: EpisodeKey) -> Self {
        Self { next: key.following(), key, step: 0, begun: true, over: false }
    }

    /// Before the first episode.
    pub fn before(next: EpisodeKey) -> Self {
        Self { next, key: next, ..Self::default() }
    }

    /// All of it, and of its episode, as plain numbers.
    pub fn to_numbers(&self, episode: &Episode) -> Vec<f64> {
        let EpisodeKey { seed, episode: number } = self.next;
        let halves = |x: u64| [f64::from(x as u32), f64::from((x >> 32) as u32)];
        let flags = [f64::from(u8::from(self.over)), f64::from(u8::from(self.begun))];
        [halves(seed), halves(number), flags].concat().into_iter().chain(episode.to_numbers()).collect()
    }

    /// How many numbers that gives.
    pub fn width(rows: EpisodeRows) -> usize {
        Self::HEAD + Episode::blank(EpisodeKey::default(), rows).to_numbers().len()
    }

    /// What [`Self::to_numbers`] wrote.
    pub fn from_numbers(rows: EpisodeRows, numbers: &[f64]) -> Result<(Self, Episode), TaskError> {
        let (head, episode) = numbers.split_at(Self::HEAD);
        let whole = |k: usize| {
            let n = head[k] as u32;
            if f64::from(n) == head[k] { Ok(n) } else { Err(TaskError::Saved(format!("{} is no count", head[k]))) }
        };
        let join = |k: usize| Ok::<u64, TaskError>(u64::from(whole(k)?) | u64::from(whole(k + 1)?) << 32);
        let episode = Episode::from_numbers(rows, episode)?;
        let slot = Self {
            next: EpisodeKey { seed: join(0)?, episode: join(2)? },
            key: episode.key(),
            step: episode.step(),
            over: whole(4)? != 0,
            begun: whole(5)? != 0,
        };
        Ok((slot, episode))
    }
}

//! Where steps write what they bring.

use super::Final;
use crate::error::ControlError;
use crate::task::INFO;

/// Places for what a step brings of N instances: slices of arrays whose first axis (last, of `info`) is the instance.
#[derive(Default)]
pub struct Outputs<'a> {
    /// Observations, (N, d).
    pub observations: &'a mut [f32],
    /// Rewards, (N,).
    pub rewards: &'a mut [f64],
    /// Whether the episode is over for a reason within the task, (N,).
    pub terminated: &'a mut [bool],
    /// Whether it is because its time is, (N,).
    pub truncated: &'a mut [bool],
    /// Measures by the names of [`crate::task::Outcome::INFO`], each (N,).
    pub info: [&'a mut [f64]; INFO],
}

/// Chunks of outputs.
pub(super) struct Chunks<'a> {
    rest: Outputs<'a>,
    count: usize,
}

impl<'a> Outputs<'a> {
    /// Of N instances, measures as (k, N).
    pub fn new(
        observations: &'a mut [f32],
        rewards: &'a mut [f64],
        [terminated, truncated]: [&'a mut [bool]; 2],
        info: &'a mut [f64],
    ) -> Self {
        let mut rows = info;
        let info = std::array::from_fn(|_| {
            let count = rewards.len().min(rows.len());
            split(&mut rows, count)
        });
        Self { observations, rewards, terminated, truncated, info }
    }

    /// Instances.
    pub fn len(&self) -> usize {
        self.rewards.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.rewards.is_empty()
    }

    /// Refuses what is not for `n` instances with observations of `width` entries.
    pub(super) fn check(&self, n: usize, width: usize) -> Result<(), ControlError> {
        let rows = self.info.iter().map(|row| ("measures", row.len(), n));
        let lengths = [
            ("observations", self.observations.len(), n * width),
            ("rewards", self.rewards.len(), n),
            ("terminated", self.terminated.len(), n),
            ("truncated", self.truncated.len(), n),
        ];
        match lengths.into_iter().chain(rows).find(|(_, got, expected)| got != expected) {
            Some((what, got, expected)) => Err(ControlError::Shape { what, got, expected }),
            None => Ok(()),
        }
    }

    /// Chunks of `count` instances; the last may have fewer.
    pub(super) fn chunks(self, count: usize) -> Chunks<'a> {
        Chunks { rest: self, count }
    }
}

impl<'a> Iterator for Chunks<'a> {
    type Item = Outputs<'a>;

    fn next(&mut self) -> Option<Outputs<'a>> {
        let (rest, count) = (&mut self.rest, self.count);
        if rest.len() <= count {
            let last = std::mem::take(rest);
            return (!last.is_empty()).then_some(last);
        }
        let width = rest.observations.len() / rest.len();
        Some(Outputs {
            observations: split(&mut rest.observations, count * width),
            rewards: split(&mut rest.rewards, count),
            terminated: split(&mut rest.terminated, count),
            truncated: split(&mut rest.truncated, count),
            info: rest.info.each_mut().map(|row| split(row, count)),
        })
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.rest.len().div_ceil(self.count);
        (left, Some(left))
    }
}

impl ExactSizeIterator for Chunks<'_> {}

/// Takes the first `count` from a slice.
fn split<'a, T>(slice: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let (first, rest) = std::mem::take(slice).split_at_mut(count);
    *slice = rest;
    first
}

/// Verdict on one instance after a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// Reward.
    pub reward: f64,
    /// The episode is over for a reason within the task.
    pub terminated: bool,
    /// The episode is over because its time is.
    pub truncated: bool,
    /// Measures, in the order of [`crate::task::Outcome::INFO`].
    pub info: [f64; INFO],
}

/// What a step brought.
#[derive(Debug, Clone, PartialEq)]
pub struct Transition {
    /// Observations, (N, d).
    pub observations: Vec<f32>,
    /// Rewards.
    pub rewards: Vec<f64>,
    /// Whether episodes are over for a reason within the task.
    pub terminated: Vec<bool>,
    /// Whether they are because their time is.
    pub truncated: Vec<bool>,
    /// Measures, (k, N).
    pub info: Vec<f64>,
    /// Ends of episodes that [`super::Autoreset::SameStep`] replaced, by instance.
    pub finals: Vec<Final>,
}

impl Transition {
    /// Memory for `n` instances with `width` entries of an observation each.
    pub(super) fn blank(n: usize, width: usize) -> Self {
        Self {
            observations: vec![0.0; n * width],
            rewards: vec![0.0; n],
            terminated: vec![false; n],
            truncated: vec![false; n],
            info: vec![0.0; INFO * n],
            finals: Vec::new(),
        }
    }

    /// All but the finals, to be written to.
    pub(super) fn outputs(&mut self) -> Outputs<'_> {
        let flags = [&mut self.terminated[..], &mut self.truncated[..]];
        Outputs::new(&mut self.observations, &mut self.rewards, flags, &mut self.info)
    }

    /// What it brought instance `i`, but for the observation.
    pub fn verdict(&self, i: usize) -> Verdict {
        let n = self.rewards.len();
        Verdict {
            reward: self.rewards[i],
            terminated: self.terminated[i],
            truncated: self.truncated[i],
            info: std::array::from_fn(|k| self.info[k * n + i]),
        }
    }

    /// What it brought each instance.
    pub fn verdicts(&self) -> impl ExactSizeIterator<Item = Verdict> + '_ {
        (0..self.rewards.len()).map(|i| self.verdict(i))
    }
}

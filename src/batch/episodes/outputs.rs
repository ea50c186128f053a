//! Outputs of steps.

use crate::error::ControlError;
use crate::task::INFO;

/// Arrays for the results of a step of N instances: slices whose first axis (last, of `info`) is the instance.
pub struct Outputs<'a> {
    /// Observations, (N, d).
    pub observations: &'a mut [f32],
    /// Rewards, (N,).
    pub rewards: &'a mut [f64],
    /// End of the episode for a reason within the task, (N,).
    pub terminated: &'a mut [bool],
    /// End of the episode by its time limit, (N,).
    pub truncated: &'a mut [bool],
    /// Metrics in the order of the task's names, each (N,); the rows past the last are empty.
    pub info: [&'a mut [f64]; INFO],
}

impl Default for Outputs<'_> {
    fn default() -> Self {
        let info = std::array::from_fn(|_| &mut [][..]);
        Self { observations: &mut [], rewards: &mut [], terminated: &mut [], truncated: &mut [], info }
    }
}

impl<'a> Outputs<'a> {
    /// Outputs of N instances, metrics as (k, N).
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

    /// Number of instances.
    pub fn len(&self) -> usize {
        self.rewards.len()
    }

    /// No instances.
    pub fn is_empty(&self) -> bool {
        self.rewards.is_empty()
    }

    /// Rows of the metrics.
    pub(super) fn metrics(&self) -> impl Iterator<Item = &[f64]> {
        self.info.iter().map(|row| &**row).filter(|row| !row.is_empty())
    }

    /// Refuses lengths that do not fit `n` instances with `width` entries of an observation and `metrics` metrics.
    pub(super) fn check(&self, n: usize, width: usize, metrics: usize) -> Result<(), ControlError> {
        let expected = |k: usize| if k < metrics { n } else { 0 };
        let rows = self.info.iter().enumerate().map(|(k, row)| ("metrics", row.len(), expected(k)));
        let lengths = [
            ("observations", self.observations.len(), n * width),
            ("rewards", self.rewards.len(), n),
            ("terminated", self.terminated.len(), n),
            ("truncated", self.truncated.len(), n),
        ];
        check_lengths(lengths.into_iter().chain(rows))
    }

    /// Chunks of `count` instances; the last may have fewer.
    pub(super) fn chunks(mut self, count: usize) -> impl ExactSizeIterator<Item = Self> {
        let width = self.observations.len() / self.len().max(1);
        (0..self.len().div_ceil(count)).map(move |_| {
            let count = count.min(self.len());
            Self {
                observations: split(&mut self.observations, count * width),
                rewards: split(&mut self.rewards, count),
                terminated: split(&mut self.terminated, count),
                truncated: split(&mut self.truncated, count),
                // Rows past the last metric are empty.
                info: self.info.each_mut().map(|row| split(row, count.min(row.len()))),
            }
        })
    }
}

/// Refuses an array, given by its name and its length, that has not the expected length.
pub(super) fn check_lengths(
    arrays: impl IntoIterator<Item = (&'static str, usize, usize)>,
) -> Result<(), ControlError> {
    match arrays.into_iter().find(|(_, got, expected)| got != expected) {
        Some((what, got, expected)) => Err(ControlError::Shape { what, got, expected }),
        None => Ok(()),
    }
}

/// Takes the first `count` from a slice.
pub(super) fn split<'a, T>(slice: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let (first, rest) = std::mem::take(slice).split_at_mut(count);
    *slice = rest;
    first
}

/// The end of an episode whose successor began in the same step.
#[derive(Debug, Clone, PartialEq)]
pub struct Final {
    /// Number of the instance in the batch.
    pub instance: usize,
    /// Last observation.
    pub observation: Vec<f32>,
    /// Last metrics.
    pub info: Vec<f64>,
    /// Privileged information: see [`TaskBatch::privileged`](super::TaskBatch::privileged).
    pub privileged: Vec<f64>,
}

impl Final {
    /// End of the episode of instance `k` of a chunk that begins with instance `first`.
    pub(super) fn of(first: usize, k: usize, out: &Outputs<'_>, privileged: Vec<f64>) -> Self {
        let width = out.observations.len() / out.len();
        Self {
            instance: first + k,
            observation: out.observations[k * width..(k + 1) * width].to_vec(),
            info: out.metrics().map(|row| row[k]).collect(),
            privileged,
        }
    }
}

/// Results of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct Transition {
    /// Observations, (N, d).
    pub observations: Vec<f32>,
    /// Rewards of the control period, (N,).
    pub rewards: Vec<f64>,
    /// Ends of episodes for a reason within the task.
    pub terminated: Vec<bool>,
    /// Ends of episodes by their time limit.
    pub truncated: Vec<bool>,
    /// Metrics, (k, N).
    pub info: Vec<f64>,
    /// Ends of episodes that [`super::Autoreset::SameStep`] replaced, by instance.
    pub finals: Vec<Final>,
}

impl Transition {
    /// Memory for `n` instances with `width` entries of an observation and `metrics` metrics each.
    pub(super) fn blank(n: usize, width: usize, metrics: usize) -> Self {
        Self {
            observations: vec![0.0; n * width],
            rewards: vec![0.0; n],
            terminated: vec![false; n],
            truncated: vec![false; n],
            info: vec![0.0; metrics * n],
            finals: Vec::new(),
        }
    }

    /// The arrays, without the finals.
    pub(super) fn outputs(&mut self) -> Outputs<'_> {
        let flags = [&mut self.terminated[..], &mut self.truncated[..]];
        Outputs::new(&mut self.observations, &mut self.rewards, flags, &mut self.info)
    }
}

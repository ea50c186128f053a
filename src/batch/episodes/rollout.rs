//! Rollouts: episodes under a controller, for many control periods on one thread at a time.

use super::chunk::Chunk;
use super::outputs::{Outputs, Transition};
use crate::control::Controller;
use crate::error::ControlError;
use crate::lane::Real;
use crate::limits::interrupt;
use crate::task::{INFO, TaskDefinition, TaskKernel};

/// Statistics of an instance's control periods up to its episode's end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RolloutStats {
    /// Number of control periods.
    pub steps: u32,
    /// Sum of the rewards.
    pub reward: f64,
    /// End of the episode for a reason within the task.
    pub terminated: bool,
    /// End of the episode by its time limit.
    pub truncated: bool,
    /// Sums of the metrics, in the order of the task's names; zeros past the last.
    pub sums: [f64; INFO],
    /// Sums of their squares.
    pub squares: [f64; INFO],
    /// Metrics after the last control period.
    pub last: [f64; INFO],
}

impl Default for RolloutStats {
    fn default() -> Self {
        let zeros = [0.0; INFO];
        Self { steps: 0, reward: 0.0, terminated: false, truncated: false, sums: zeros, squares: zeros, last: zeros }
    }
}

/// Record of one instance's control periods up to its episode's end.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trace {
    /// Instance.
    pub instance: usize,
    /// Observations of the controller, (T, d).
    pub observations: Vec<f32>,
    /// Its actions, (T, a).
    pub actions: Vec<f32>,
    /// Rewards, (T,).
    pub rewards: Vec<f64>,
    /// Metrics after each control period, (T, k).
    pub info: Vec<f64>,
}

/// Memory of a controller, statistics and records of a batch's instances.
#[derive(Debug, Clone, PartialEq)]
pub struct Rollout {
    /// (N, m)
    pub(super) memory: Vec<f64>,
    pub(super) stats: Vec<RolloutStats>,
    /// Records of chosen instances, in ascending order.
    pub(super) traces: Vec<Trace>,
}

impl Rollout {
    /// A rollout of `instances` instances with blank memory. The instances in `traced` are recorded.
    ///
    /// # Errors
    /// `ControlError::Instance` for an instance out of range.
    pub fn new(controller: &dyn Controller, instances: usize, traced: &[usize]) -> Result<Self, ControlError> {
        if let Some(&got) = traced.iter().find(|i| **i >= instances) {
            return Err(ControlError::Instance { instance: got, instances });
        }
        let mut traced = traced.to_vec();
        traced.sort_unstable();
        traced.dedup();
        let trace = |instance| Trace { instance, ..Trace::default() };
        Ok(Self {
            memory: vec![0.0; instances * controller.widths().memory],
            stats: vec![RolloutStats::default(); instances],
            traces: traced.into_iter().map(trace).collect(),
        })
    }

    /// Statistics of each instance.
    pub fn stats(&self) -> &[RolloutStats] {
        &self.stats
    }

    /// Records of the chosen instances, in ascending order.
    pub fn traces(&self) -> &[Trace] {
        &self.traces
    }

    /// Returns the statistics so far and clears them; the controller's memory stays.
    pub fn pop_stats(&mut self) -> Vec<RolloutStats> {
        let blank = vec![RolloutStats::default(); self.stats.len()];
        std::mem::replace(&mut self.stats, blank)
    }
}

/// Part of a rollout for one chunk.
pub(super) struct RolloutChunk<'a> {
    pub controller: &'a dyn Controller,
    pub steps: u32,
    pub memory: &'a mut [f64],
    pub stats: &'a mut [RolloutStats],
    pub traces: &'a mut [Trace],
}

impl RolloutChunk<'_> {
    /// Runs the instances of a chunk, whose rules have no autoreset: ended episodes stay as they are.
    pub fn run<T: Real, K: TaskDefinition>(&mut self, chunk: &mut Chunk<'_, '_, T, K>) -> Result<(), ControlError> {
        let (n, first) = (chunk.slots.len(), chunk.part.first);
        let widths = self.controller.widths();
        let mut transition = Transition::blank(n, widths.observation, TaskKernel::<T, K>::metrics());
        let mut actions = vec![0.0; n * widths.action];
        let mut runs = vec![false; n];
        chunk.observe(&vec![true; n], &mut transition.outputs());
        for _ in 0..self.steps {
            for (runs, slot) in runs.iter_mut().zip(&*chunk.slots) {
                *runs = !slot.over;
            }
            if !runs.contains(&true) {
                break;
            }
            self.controller.act(&transition.observations, self.memory, &mut actions)?;
            if interrupt::requested() {
                break;
            }
            for trace in self.traces.iter_mut().filter(|trace| runs[trace.instance - first]) {
                let k = trace.instance - first;
                trace.observations.extend(&transition.observations[k * widths.observation..][..widths.observation]);
                trace.actions.extend(&actions[k * widths.action..][..widths.action]);
            }
            let mut out = transition.outputs();
            chunk.step(&actions, &mut out, &mut Vec::new());
            for (k, stats) in self.stats.iter_mut().enumerate().filter(|(k, _)| runs[*k]) {
                stats.add(k, &out);
            }
            for trace in self.traces.iter_mut().filter(|trace| runs[trace.instance - first]) {
                let k = trace.instance - first;
                trace.rewards.push(out.rewards[k]);
                trace.info.extend(out.metrics().map(|row| row[k]));
            }
        }
        Ok(())
    }
}

impl RolloutStats {
    /// Adds the results of instance `k` of `out`.
    fn add(&mut self, k: usize, out: &Outputs<'_>) {
        self.steps += 1;
        self.reward += out.rewards[k];
        self.terminated |= out.terminated[k];
        self.truncated |= out.truncated[k];
        for (entry, row) in out.metrics().enumerate() {
            self.sums[entry] += row[k];
            self.squares[entry] += row[k] * row[k];
            self.last[entry] = row[k];
        }
    }
}

/// Takes from `rest` the records of instances before `end`.
pub(super) fn take_before<'a>(rest: &mut &'a mut [Trace], end: usize) -> &'a mut [Trace] {
    let count = rest.partition_point(|trace| trace.instance < end);
    let (front, back) = std::mem::take(rest).split_at_mut(count);
    *rest = back;
    front
}

//! Rollouts: episodes under a controller, with statistics and records.

use super::closed_loop::{LoopPart, Present};
use super::outputs::{Outputs, split};
use crate::batch::stepping::chunk::CHUNK;
use crate::control::Controller;
use crate::error::ControlError;
use crate::limits::interrupt;
use crate::task::INFO;

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
    /// Number of the instance in the batch.
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

    /// Parts of chunks under a controller.
    pub(super) fn parts<'a>(&'a mut self, controller: &'a dyn Controller) -> Vec<Box<dyn LoopPart + 'a>> {
        let (mut traces, mut memory) = (&mut self.traces[..], &mut self.memory[..]);
        let chunks = self.stats.chunks_mut(CHUNK).enumerate();
        let part = |(k, stats): (usize, &'a mut [RolloutStats])| {
            let count = traces.partition_point(|trace| trace.instance < (k + 1) * CHUNK);
            let memory = split(&mut memory, stats.len() * controller.widths().memory);
            let traces = split(&mut traces, count);
            Box::new(RolloutChunk { controller, first: k * CHUNK, memory, stats, traces }) as Box<dyn LoopPart>
        };
        chunks.map(part).collect()
    }

    /// Returns the statistics so far and clears them; the controller's memory stays.
    pub fn pop_stats(&mut self) -> Vec<RolloutStats> {
        let blank = vec![RolloutStats::default(); self.stats.len()];
        std::mem::replace(&mut self.stats, blank)
    }
}

/// Part of a rollout for one chunk.
struct RolloutChunk<'a> {
    controller: &'a dyn Controller,
    /// First instance.
    first: usize,
    memory: &'a mut [f64],
    stats: &'a mut [RolloutStats],
    traces: &'a mut [Trace],
}

impl LoopPart for RolloutChunk<'_> {
    fn act(
        &mut self,
        _t: usize,
        running: &[bool],
        observations: &[f32],
        _present: &mut dyn Present,
        actions: &mut [f32],
    ) -> Result<bool, ControlError> {
        if !running.contains(&true) {
            return Ok(false);
        }
        self.controller.act(observations, self.memory, actions)?;
        if interrupt::requested() {
            return Ok(false);
        }
        let widths = self.controller.widths();
        for trace in self.traces.iter_mut().filter(|trace| running[trace.instance - self.first]) {
            let k = trace.instance - self.first;
            trace.observations.extend(&observations[k * widths.observation..][..widths.observation]);
            trace.actions.extend(&actions[k * widths.action..][..widths.action]);
        }
        Ok(true)
    }

    fn record(&mut self, _t: usize, running: &[bool], out: &Outputs<'_>) {
        for (k, stats) in self.stats.iter_mut().enumerate().filter(|(k, _)| running[*k]) {
            stats.add(k, out);
        }
        for trace in self.traces.iter_mut().filter(|trace| running[trace.instance - self.first]) {
            let k = trace.instance - self.first;
            trace.rewards.push(out.rewards[k]);
            trace.info.extend(out.metrics().map(|row| row[k]));
        }
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

//! Closed loops: episodes under a policy, for many control periods on one thread at a time.

use super::chunk::Chunk;
use super::outputs::{Outputs, Transition};
use crate::control::Controller;
use crate::error::ControlError;
use crate::lane::Real;
use crate::task::INFO;

/// What came of an instance's control periods; those after its episode's end do not count.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tally {
    /// Control periods that count.
    pub steps: u32,
    /// Sum of the rewards.
    pub reward: f64,
    /// The episode ended for a reason within the task.
    pub terminated: bool,
    /// The episode ended because its time did.
    pub truncated: bool,
    /// Sums of the measures, in the order of [`crate::task::Outcome::INFO`].
    pub sums: [f64; INFO],
    /// Sums of their squares.
    pub squares: [f64; INFO],
    /// Themselves after the last of the control periods.
    pub last: [f64; INFO],
}

/// Every control period of one instance, as far as it counts.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trace {
    /// Instance.
    pub instance: usize,
    /// What the policy saw, (T, d).
    pub observations: Vec<f32>,
    /// What it did, (T, a).
    pub actions: Vec<f32>,
    /// What came of it, (T,).
    pub rewards: Vec<f64>,
    /// Measures thereafter, (T, k).
    pub info: Vec<f64>,
}

/// What a policy remembers of a batch's instances, and what came of it so far.
#[derive(Debug, Clone, PartialEq)]
pub struct Rollout {
    /// (N, m)
    pub(super) memory: Vec<f64>,
    pub(super) tallies: Vec<Tally>,
    /// Of chosen instances, in ascending order.
    pub(super) traces: Vec<Trace>,
}

impl Rollout {
    /// Of a policy that remembers nothing yet of `instances` instances. The instances that `traced` names are recorded.
    ///
    /// # Errors
    /// `ControlError::Instance` for one that there is not.
    pub fn new(policy: &dyn Controller, instances: usize, traced: &[usize]) -> Result<Self, ControlError> {
        if let Some(&got) = traced.iter().find(|i| **i >= instances) {
            return Err(ControlError::Instance { instance: got, instances });
        }
        let mut traced = traced.to_vec();
        traced.sort_unstable();
        traced.dedup();
        let trace = |instance| Trace { instance, ..Trace::default() };
        Ok(Self {
            memory: vec![0.0; instances * policy.widths().memory],
            tallies: vec![Tally::default(); instances],
            traces: traced.into_iter().map(trace).collect(),
        })
    }

    /// What came of each instance.
    pub fn tallies(&self) -> &[Tally] {
        &self.tallies
    }

    /// Records of the chosen instances, in ascending order.
    pub fn traces(&self) -> &[Trace] {
        &self.traces
    }

    /// Counts anew from here on; the policy forgets nothing.
    pub fn count_anew(&mut self) {
        self.tallies.fill(Tally::default());
    }
}

/// The part of a rollout that belongs to a chunk.
pub(super) struct Lap<'a> {
    pub policy: &'a dyn Controller,
    pub steps: u32,
    pub memory: &'a mut [f64],
    pub tallies: &'a mut [Tally],
    pub traces: &'a mut [Trace],
}

impl Lap<'_> {
    /// Runs the instances of a chunk. Its rules have no autoreset: episodes that are over stay so.
    pub fn run<T: Real>(&mut self, chunk: &mut Chunk<'_, '_, T>) -> Result<(), ControlError> {
        let (n, first) = (chunk.slots.len(), chunk.part.first);
        let widths = self.policy.widths();
        let mut seen = Transition::blank(n, widths.observation);
        let mut actions = vec![0.0; n * widths.action];
        let mut runs = vec![false; n];
        chunk.look(&vec![true; n], &mut seen.outputs());
        for _ in 0..self.steps {
            for (runs, slot) in runs.iter_mut().zip(&*chunk.slots) {
                *runs = !slot.over;
            }
            if !runs.contains(&true) {
                break;
            }
            self.policy.act(&seen.observations, self.memory, &mut actions)?;
            for trace in self.traces.iter_mut().filter(|trace| runs[trace.instance - first]) {
                let k = trace.instance - first;
                trace.observations.extend(&seen.observations[k * widths.observation..][..widths.observation]);
                trace.actions.extend(&actions[k * widths.action..][..widths.action]);
            }
            let mut out = seen.outputs();
            chunk.step(&actions, &mut out, &mut Vec::new());
            for (k, tally) in self.tallies.iter_mut().enumerate().filter(|(k, _)| runs[*k]) {
                tally.add(k, &out);
            }
            for trace in self.traces.iter_mut().filter(|trace| runs[trace.instance - first]) {
                let k = trace.instance - first;
                trace.rewards.push(out.rewards[k]);
                trace.info.extend(out.info.iter().map(|row| row[k]));
            }
        }
        Ok(())
    }
}

impl Tally {
    /// Adds what a control period brought instance `k` of `out`.
    fn add(&mut self, k: usize, out: &Outputs<'_>) {
        self.steps += 1;
        self.reward += out.rewards[k];
        self.terminated |= out.terminated[k];
        self.truncated |= out.truncated[k];
        for (entry, row) in out.info.iter().enumerate() {
            self.sums[entry] += row[k];
            self.squares[entry] += row[k] * row[k];
            self.last[entry] = row[k];
        }
    }
}

/// The front part of `rest` that belongs to instances before `end`.
pub(super) fn take_before<'a>(rest: &mut &'a mut [Trace], end: usize) -> &'a mut [Trace] {
    let count = rest.partition_point(|trace| trace.instance < end);
    let (front, back) = std::mem::take(rest).split_at_mut(count);
    *rest = back;
    front
}

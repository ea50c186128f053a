//! Recordings for training: episodes under a network whose actions have noise, with perfect observations and, if asked
//! for, a teacher's actions on these.

use super::chunk::Chunk;
use super::outputs::{Transition, split};
use crate::control::{Controller, Mlp};
use crate::error::ControlError;
use crate::lane::Real;
use crate::limits::interrupt;
use crate::task::{TaskDefinition, TaskKernel};

/// Controller on perfect observations, whose actions are recorded.
#[derive(Clone, Copy)]
pub struct Teacher<'a> {
    /// The controller.
    pub controller: &'a dyn Controller,
    /// Its actions are taken in place of the actor's.
    pub acts: bool,
}

/// Actor, noise and teacher of a recording.
#[derive(Clone, Copy)]
pub struct Recorder<'a> {
    /// Network on the environment's observations.
    pub actor: &'a Mlp,
    /// Noise on the actions, (N, T, a).
    pub noise: &'a [f32],
    /// Teacher, if any.
    pub teacher: Option<Teacher<'a>>,
}

/// The first T control periods of an episode of each of N instances.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording {
    /// Observations, after h - 1 rows of zeros where the actor has a history of h: (N, h - 1 + T, d).
    pub observations: Vec<f32>,
    /// Perfect observations, that after the last period included: (N, T + 1, d).
    pub perfect: Vec<f32>,
    /// Actions with noise, not clipped, (N, T, a).
    pub actions: Vec<f32>,
    /// Rewards, (N, T).
    pub rewards: Vec<f32>,
    /// Periods up to the end of the episode, (N, T).
    pub alive: Vec<bool>,
    /// Period that ended it for a reason within the task, (N, T).
    pub terminated: Vec<bool>,
    /// Actions of the teacher, (N, T, a); empty without one.
    pub targets: Vec<f32>,
}

impl Recording {
    /// Memory for `n` instances and as many periods as there is noise for.
    pub(super) fn blank(recorder: &Recorder<'_>, n: usize) -> Self {
        let widths = recorder.actor.widths();
        let (rows, d) = (recorder.noise.len() / widths.action, widths.observation);
        Self {
            observations: vec![0.0; (n * before(recorder.actor) + rows) * d],
            perfect: vec![0.0; (n + rows) * d],
            actions: recorder.noise.to_vec(),
            rewards: vec![0.0; rows],
            alive: vec![false; rows],
            terminated: vec![false; rows],
            targets: if recorder.teacher.is_some() { vec![0.0; recorder.noise.len()] } else { Vec::new() },
        }
    }

    /// Parts of `count` instances; the last may have fewer.
    pub(super) fn chunks<'a>(&'a mut self, recorder: Recorder<'a>, n: usize, count: usize) -> Vec<RecordingChunk<'a>> {
        let steps = self.rewards.len() / n;
        let widths = recorder.actor.widths();
        let (a, d) = (widths.action, widths.observation);
        let mut observations = &mut self.observations[..];
        let (mut perfect, mut actions) = (&mut self.perfect[..], &mut self.actions[..]);
        let (mut rewards, mut alive) = (&mut self.rewards[..], &mut self.alive[..]);
        let (mut terminated, mut targets) = (&mut self.terminated[..], &mut self.targets[..]);
        let sizes = (0..n).step_by(count).map(|first| count.min(n - first));
        let chunk = |m: usize| RecordingChunk {
            recorder,
            steps,
            observations: split(&mut observations, m * (before(recorder.actor) + steps) * d),
            perfect: split(&mut perfect, m * (steps + 1) * d),
            actions: split(&mut actions, m * steps * a),
            rewards: split(&mut rewards, m * steps),
            alive: split(&mut alive, m * steps),
            terminated: split(&mut terminated, m * steps),
            targets: split(&mut targets, if recorder.teacher.is_some() { m * steps * a } else { 0 }),
        };
        sizes.map(chunk).collect()
    }
}

/// Rows of zeros before the observations.
fn before(actor: &Mlp) -> usize {
    actor.network().history - 1
}

/// Part of a recording for one chunk.
pub(super) struct RecordingChunk<'a> {
    recorder: Recorder<'a>,
    steps: usize,
    observations: &'a mut [f32],
    perfect: &'a mut [f32],
    /// Noise, then actions.
    actions: &'a mut [f32],
    rewards: &'a mut [f32],
    alive: &'a mut [bool],
    terminated: &'a mut [bool],
    targets: &'a mut [f32],
}

impl RecordingChunk<'_> {
    /// Runs the instances of a chunk, whose rules have no autoreset: ended episodes stay as they are.
    pub fn run<T: Real, K: TaskDefinition>(&mut self, chunk: &mut Chunk<'_, '_, T, K>) -> Result<(), ControlError> {
        let Recorder { actor, teacher, .. } = self.recorder;
        let (n, steps, before, widths) = (chunk.slots.len(), self.steps, before(actor), actor.widths());
        let (a, d) = (widths.action, widths.observation);
        let mut transition = Transition::blank(n, d, TaskKernel::<T, K>::metrics());
        let mut perfect = vec![0.0; n * d];
        let mut inputs = vec![0.0; n * (before + 1) * d];
        let mut actions = vec![0.0; n * a];
        let mut targets = actions.clone();
        let mut memory = vec![0.0; n * teacher.map_or(0, |teacher| teacher.controller.widths().memory)];
        chunk.observe(&vec![true; n], &mut transition.outputs());
        for t in 0..steps {
            if interrupt::requested() {
                break;
            }
            chunk.observe_perfect(&mut perfect);
            put(&perfect, self.perfect, d, [t, steps + 1]);
            put(&transition.observations, self.observations, d, [before + t, before + steps]);
            if let Some(Teacher { controller, .. }) = teacher {
                controller.act(&perfect, &mut memory, &mut targets)?;
                put(&targets, self.targets, a, [t, steps]);
            }
            if teacher.is_some_and(|teacher| teacher.acts) {
                actions.copy_from_slice(&targets);
            } else {
                let stacks = self.observations.chunks_exact((before + steps) * d);
                for (input, rows) in inputs.chunks_exact_mut((before + 1) * d).zip(stacks) {
                    input.copy_from_slice(&rows[t * d..][..(before + 1) * d]);
                }
                actor.mean(&inputs, &mut actions);
            }
            for (k, row) in actions.chunks_exact_mut(a).enumerate() {
                let kept = &mut self.actions[(k * steps + t) * a..][..a];
                for (action, kept) in row.iter_mut().zip(kept) {
                    *action += *kept;
                    *kept = *action;
                }
            }
            for (k, slot) in chunk.slots.iter().enumerate() {
                self.alive[k * steps + t] = !slot.over;
            }
            let mut out = transition.outputs();
            chunk.step(&actions, &mut out, &mut Vec::new());
            for k in 0..n {
                let at = k * steps + t;
                self.rewards[at] = out.rewards[k] as f32;
                self.terminated[at] = self.alive[at] && out.terminated[k];
            }
        }
        chunk.observe_perfect(&mut perfect);
        put(&perfect, self.perfect, d, [steps, steps + 1]);
        Ok(())
    }
}

/// Copies rows of `width` numbers, one per instance, to row `at` of each instance's `rows` rows.
fn put(from: &[f32], to: &mut [f32], width: usize, [at, rows]: [usize; 2]) {
    for (row, all) in from.chunks_exact(width).zip(to.chunks_exact_mut(rows * width)) {
        all[at * width..][..width].copy_from_slice(row);
    }
}

//! Recordings for training: episodes under a network whose actions have noise, with perfect observations and, if asked
//! for, a teacher's actions on these.

use super::closed_loop::{LoopPart, Present};
use super::outputs::{Outputs, split};
use crate::batch::stepping::chunk::CHUNK;
use crate::control::{Controller, Mlp};
use crate::error::ControlError;
use crate::limits::interrupt;

/// Controller on perfect observations, whose actions are recorded.
#[derive(Clone, Copy)]
pub struct Teacher<'a> {
    /// Controller that sees the true state.
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
    /// Number of entries of a frame's state and memory where frames are recorded: see [`super::TaskBatch::frames`].
    pub frames: [usize; 2],
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
    /// States and memories, after the last period too, (N, T + 1, .); empty where none are recorded.
    pub frames: [Vec<f32>; 2],
}

impl Recording {
    /// Memory for `n` instances; the noise determines the number of periods.
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
            frames: recorder.frames.map(|width| vec![0.0; (n + rows) * width]),
        }
    }

    /// Parts of chunks of the `n` instances.
    pub(super) fn parts<'a>(&'a mut self, recorder: Recorder<'a>, n: usize) -> Vec<Box<dyn LoopPart + 'a>> {
        let steps = self.rewards.len() / n;
        let widths = recorder.actor.widths();
        let (a, d, before) = (widths.action, widths.observation, before(recorder.actor));
        let mut observations = &mut self.observations[..];
        let (mut perfect, mut actions) = (&mut self.perfect[..], &mut self.actions[..]);
        let (mut rewards, mut alive) = (&mut self.rewards[..], &mut self.alive[..]);
        let (mut terminated, mut targets) = (&mut self.terminated[..], &mut self.targets[..]);
        let [mut states, mut memories] = self.frames.each_mut().map(|frames| &mut frames[..]);
        let sizes = (0..n).step_by(CHUNK).map(|first| CHUNK.min(n - first));
        let part = |m: usize| {
            let memory = recorder.teacher.map_or(0, |teacher| teacher.controller.widths().memory);
            Box::new(RecordingChunk {
                recorder,
                steps,
                observations: split(&mut observations, m * (before + steps) * d),
                perfect: split(&mut perfect, m * (steps + 1) * d),
                actions: split(&mut actions, m * steps * a),
                rewards: split(&mut rewards, m * steps),
                alive: split(&mut alive, m * steps),
                terminated: split(&mut terminated, m * steps),
                targets: split(&mut targets, if recorder.teacher.is_some() { m * steps * a } else { 0 }),
                frames: [
                    split(&mut states, m * (steps + 1) * recorder.frames[0]),
                    split(&mut memories, m * (steps + 1) * recorder.frames[1]),
                ],
                now: vec![0.0; m * d],
                inputs: vec![0.0; m * (before + 1) * d],
                memory: vec![0.0; m * memory],
            }) as Box<dyn LoopPart>
        };
        sizes.map(part).collect()
    }
}

/// Rows of zeros before the observations.
fn before(actor: &Mlp) -> usize {
    actor.network().history - 1
}

/// Part of a recording for one chunk.
struct RecordingChunk<'a> {
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
    frames: [&'a mut [f32]; 2],
    /// Perfect observations of the present control instant.
    now: Vec<f32>,
    /// Stacked observations of the actor.
    inputs: Vec<f32>,
    /// Memory of the teacher.
    memory: Vec<f64>,
}

impl RecordingChunk<'_> {
    /// Records perfect observations and, if asked for, frames before control period `t`.
    fn record_present(&mut self, t: usize, present: &mut dyn Present) {
        let at = [t, self.steps + 1];
        present.perfect(&mut self.now);
        put(&self.now, self.perfect, self.recorder.actor.widths().observation, at);
        if self.recorder.frames != [0, 0] {
            for ((from, to), width) in present.frames().iter().zip(&mut self.frames).zip(self.recorder.frames) {
                put(from, to, width, at);
            }
        }
    }
}

impl LoopPart for RecordingChunk<'_> {
    fn act(
        &mut self,
        t: usize,
        running: &[bool],
        observations: &[f32],
        present: &mut dyn Present,
        actions: &mut [f32],
    ) -> Result<bool, ControlError> {
        if interrupt::requested() {
            return Ok(false);
        }
        let Recorder { actor, teacher, .. } = self.recorder;
        let (steps, before, widths) = (self.steps, before(actor), actor.widths());
        let (a, d) = (widths.action, widths.observation);
        self.record_present(t, present);
        put(observations, self.observations, d, [before + t, before + steps]);
        if let Some(Teacher { controller, .. }) = teacher {
            controller.act(&self.now, &mut self.memory, actions)?;
            put(actions, self.targets, a, [t, steps]);
        }
        if !teacher.is_some_and(|teacher| teacher.acts) {
            let stacks = self.observations.chunks_exact((before + steps) * d);
            for (input, rows) in self.inputs.chunks_exact_mut((before + 1) * d).zip(stacks) {
                input.copy_from_slice(&rows[t * d..][..(before + 1) * d]);
            }
            actor.mean(&self.inputs, actions);
        }
        for (k, row) in actions.chunks_exact_mut(a).enumerate() {
            for (action, noise) in row.iter_mut().zip(&mut self.actions[(k * steps + t) * a..][..a]) {
                *action += *noise;
                *noise = *action;
            }
        }
        for (k, running) in running.iter().enumerate() {
            self.alive[k * steps + t] = *running;
        }
        Ok(true)
    }

    fn record(&mut self, t: usize, running: &[bool], out: &Outputs<'_>) {
        for k in 0..running.len() {
            let at = k * self.steps + t;
            self.rewards[at] = out.rewards[k] as f32;
            self.terminated[at] = running[k] && out.terminated[k];
        }
    }

    fn end(&mut self, present: &mut dyn Present) {
        self.record_present(self.steps, present);
    }
}

/// Copies rows of `width` numbers, one per instance, to row `at` of each instance's `rows` rows.
fn put(from: &[f32], to: &mut [f32], width: usize, [at, rows]: [usize; 2]) {
    for (row, all) in from.chunks_exact(width).zip(to.chunks_exact_mut(rows * width)) {
        all[at * width..][..width].copy_from_slice(row);
    }
}

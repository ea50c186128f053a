//! Closed loop of many control periods, on one thread at a time.

use super::chunk::{Chunk, frames};
use super::outputs::{Outputs, Transition};
use crate::batch::stepping::chunk::CHUNK;
use crate::error::ControlError;
use crate::lane::Real;
use crate::task::{TaskDefinition, TaskKernel};

/// Instances of one chunk at their current control instant.
pub(super) trait Present {
    /// Writes perfect observations, (n, d).
    fn perfect(&mut self, to: &mut [f32]);
    /// States and memories, (n, .): see [`super::TaskBatch::frames`].
    fn frames(&self) -> [Vec<f32>; 2];
}

impl<T: Real, K: TaskDefinition> Present for Chunk<'_, '_, T, K> {
    fn perfect(&mut self, observations: &mut [f32]) {
        let all = &[true; CHUNK][..self.slots.len()];
        self.observe_as(all, true, &mut Outputs { observations, ..Outputs::default() });
    }

    fn frames(&self) -> [Vec<f32>; 2] {
        frames(&self.part.table.layout, self.part.rows, self.kernel.rows(), self.episodes, self.slots.len())
    }
}

/// Policy of the instances of one chunk, and records of their control periods.
pub(super) trait LoopPart: Send {
    /// Sets the actions (n, a) of control period `t` from observations (n, d); false ends the loop. `running` is true for
    /// instances whose episode is not over.
    fn act(
        &mut self,
        t: usize,
        running: &[bool],
        observations: &[f32],
        present: &mut dyn Present,
        actions: &mut [f32],
    ) -> Result<bool, ControlError>;
    /// Records the results of control period `t`.
    fn record(&mut self, t: usize, running: &[bool], out: &Outputs<'_>);
    /// Ends the loop after its last control period.
    fn end(&mut self, _present: &mut dyn Present) {}
}

/// Runs the instances of a chunk, whose rules have no autoreset: ended episodes stay as they are.
pub(super) fn run<T: Real, K: TaskDefinition>(
    chunk: &mut Chunk<'_, '_, T, K>,
    part: &mut dyn LoopPart,
    steps: usize,
) -> Result<(), ControlError> {
    let (n, task) = (chunk.slots.len(), chunk.context.task);
    let mut transition = Transition::blank(n, task.observation_len(), TaskKernel::<T, K>::metrics());
    let mut actions = vec![0.0; n * task.action_len()];
    let mut running = vec![true; n];
    chunk.observe(&running, &mut transition.outputs());
    for t in 0..steps {
        for (running, slot) in running.iter_mut().zip(&*chunk.slots) {
            *running = !slot.over;
        }
        if !part.act(t, &running, &transition.observations, chunk, &mut actions)? {
            return Ok(());
        }
        let mut out = transition.outputs();
        chunk.step(&actions, &mut out, &mut Vec::new());
        part.record(t, &running, &out);
    }
    part.end(chunk);
    Ok(())
}

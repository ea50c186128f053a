//! Residual policy: learned corrections to a controller.

use std::sync::Arc;

use super::controller::{Controller, Widths, act_in_columns};
use super::{Mlp, PolicySpec};
use crate::error::ControlError;

/// Name of the block that a residual network reads after the observation.
pub const BASE_ACTION: &str = "base_action";

/// A base controller and a residual network: the network reads the observation and the base's action, and the action is `clip(base + limit * clip(network))`, each clip to [-1, 1]. `[Sil18]`
pub struct ResidualController {
    base: Arc<dyn Controller>,
    correction: Arc<Mlp>,
    limit: f32,
}

impl ResidualController {
    /// `limit` is the maximum correction of an entry of the action.
    ///
    /// # Errors
    /// `ControlError` for a network that does not read and write rows of these lengths, or a limit beyond [0, 1].
    pub fn new(base: Arc<dyn Controller>, correction: Arc<Mlp>, limit: f64) -> Result<Self, ControlError> {
        if !(0.0..=1.0).contains(&limit) {
            return Err(ControlError::Limit { name: "limit", value: limit });
        }
        let (own, network) = (base.widths(), correction.widths());
        let (expected, takes) = (own.observation + own.action, own.action);
        if (network.observation, network.action) != (expected, takes) {
            return Err(ControlError::Widths { got: network.observation, gives: network.action, expected, takes });
        }
        Ok(Self { base, correction, limit: limit as f32 })
    }
}

impl Controller for ResidualController {
    fn widths(&self) -> Widths {
        let base = self.base.widths();
        Widths { memory: base.memory + self.correction.widths().memory, ..base }
    }

    fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        let mut layout = self.base.memory_layout();
        layout.extend(self.correction.memory_layout());
        layout
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        let Widths { observation, memory: width, action } = self.widths();
        self.widths().rows(observations, memory, actions)?;
        // A row of memory is the base's and then the network's.
        let split = self.base.widths().memory;
        act_in_columns(&*self.base, observations, memory, width, 0..split, actions)?;
        let mut inputs = Vec::with_capacity(observations.len() + actions.len());
        for (row, action) in observations.chunks_exact(observation).zip(actions.chunks_exact(action)) {
            inputs.extend_from_slice(row);
            inputs.extend_from_slice(action);
        }
        let mut corrections = vec![0.0; actions.len()];
        act_in_columns(&*self.correction, &inputs, memory, width, split..width, &mut corrections)?;
        for (a, correction) in actions.iter_mut().zip(corrections) {
            *a = (*a + self.limit * correction.clamp(-1.0, 1.0)).clamp(-1.0, 1.0);
        }
        Ok(())
    }
}

impl PolicySpec {
    /// Spec of a residual network in this environment.
    #[must_use]
    pub fn residual(mut self) -> Self {
        self.observation.push((BASE_ACTION.to_owned(), self.actions));
        self
    }

    /// True for a residual network.
    pub fn is_residual(&self) -> bool {
        self.observation.last().is_some_and(|(name, _)| name == BASE_ACTION)
    }
}

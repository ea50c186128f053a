//! Learned corrections to a controller.

use std::sync::Arc;

use super::controller::{Controller, Widths};
use super::{Mlp, PolicySpec};
use crate::error::ControlError;

/// Name of the block that a correcting network reads after the observation.
pub const BASE_ACTION: &str = "base_action";

/// A controller and a network that corrects it: the network reads the observation and then the controller's action, and
/// the action is `clip(base + limit * clip(network))`, each clip to [-1, 1]. `[Sil18]`
pub struct Residual {
    base: Arc<dyn Controller>,
    correction: Arc<Mlp>,
    limit: f32,
}

impl Residual {
    /// `limit` is the greatest correction of an entry of the action.
    ///
    /// # Errors
    /// `ControlError` for a network that does not read and write rows of these lengths, or a limit beyond [0, 1].
    pub fn new(base: Arc<dyn Controller>, correction: Arc<Mlp>, limit: f64) -> Result<Self, ControlError> {
        if !(0.0..=1.0).contains(&limit) {
            return Err(ControlError::Limit { name: "limit", value: limit });
        }
        let (whole, own) = (base.widths(), correction.widths());
        let (expected, takes) = (whole.observation + whole.action, whole.action);
        if (own.observation, own.action) != (expected, takes) {
            return Err(ControlError::Widths { got: own.observation, gives: own.action, expected, takes });
        }
        Ok(Self { base, correction, limit: limit as f32 })
    }
}

impl Controller for Residual {
    fn widths(&self) -> Widths {
        let base = self.base.widths();
        Widths { memory: base.memory + self.correction.widths().memory, ..base }
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        let Widths { observation, memory: remembered, action } = self.widths();
        self.widths().rows(observations, memory, actions)?;
        // A row of memory is the base's and then the network's.
        let (split, mut theirs, mut own) = (self.base.widths().memory, Vec::new(), Vec::new());
        for row in memory.chunks_exact(remembered.max(1)) {
            theirs.extend_from_slice(&row[..split]);
            own.extend_from_slice(&row[split..]);
        }
        self.base.act(observations, &mut theirs, actions)?;
        let mut seen = Vec::with_capacity(observations.len() + actions.len());
        for (row, base) in observations.chunks_exact(observation).zip(actions.chunks_exact(action)) {
            seen.extend_from_slice(row);
            seen.extend_from_slice(base);
        }
        let mut corrections = vec![0.0; actions.len()];
        self.correction.act(&seen, &mut own, &mut corrections)?;
        for (i, row) in memory.chunks_exact_mut(remembered.max(1)).enumerate() {
            row[..split].copy_from_slice(&theirs[i * split..(i + 1) * split]);
            row[split..].copy_from_slice(&own[i * (remembered - split)..(i + 1) * (remembered - split)]);
        }
        for (a, correction) in actions.iter_mut().zip(corrections) {
            *a = (*a + self.limit * correction.clamp(-1.0, 1.0)).clamp(-1.0, 1.0);
        }
        Ok(())
    }
}

impl PolicySpec {
    /// The spec of a network that corrects a controller in this environment.
    #[must_use]
    pub fn residual(mut self) -> Self {
        self.observation.push((BASE_ACTION.to_owned(), self.actions));
        self
    }

    /// Whether it is that of a network that corrects a controller.
    pub fn is_residual(&self) -> bool {
        self.observation.last().is_some_and(|(name, _)| name == BASE_ACTION)
    }
}

//! Weighted mean of controllers.

use std::sync::Arc;

use super::controller::{Controller, Widths, act_in_columns};
use super::indices::{ATTITUDE_LEVER, BlockIndices};
use crate::error::ControlError;

/// Most that the weights' sum may be off 1, by rounding.
const ROUNDING: f64 = 1e-9;

/// Hands over from the first controller of a blend to the second where the measured pose error is large.
#[derive(Debug, Clone, PartialEq)]
pub struct Guard {
    error: BlockIndices,
    range: [f64; 2],
}

impl Guard {
    /// For the pose error at these entries of an observation: the first weight goes over to the second linearly between two errors, m.
    ///
    /// # Errors
    /// `ControlError::Guard` for errors that are negative, not finite or not in order.
    pub fn new(error: BlockIndices, range: [f64; 2]) -> Result<Self, ControlError> {
        let [from, to] = range;
        if !(0.0 <= from && from < to && to.is_finite()) {
            return Err(ControlError::Guard { from, to });
        }
        Ok(Self { error, range })
    }

    /// Share that is handed over.
    fn share(&self, observation: &[f32]) -> f64 {
        let six = self.error.six(observation);
        let (position, attitude) = six.split_at(3);
        let squares = |three: &[f64]| three.iter().map(|x| x * x).sum::<f64>();
        let error = (squares(position) + ATTITUDE_LEVER.powi(2) * squares(attitude)).sqrt();
        let [from, to] = self.range;
        ((error - from) / (to - from)).clamp(0.0, 1.0)
    }
}

/// Controllers on the same observations: the action is `clip(sum w_i clip(a_i))`, each clip to [-1, 1].
///
/// The memory is that of all controllers, one after the other, and with a guard the share that it hands over.
pub struct Blend {
    parts: Vec<(Arc<dyn Controller>, f64)>,
    guard: Option<Guard>,
}

impl Blend {
    /// Controllers and their weights.
    ///
    /// # Errors
    /// `ControlError` for no parts, rows of different lengths, a weight beyond [0, 1], weights whose sum is not 1, or a guard
    /// without a second controller.
    pub fn new(parts: Vec<(Arc<dyn Controller>, f64)>, guard: Option<Guard>) -> Result<Self, ControlError> {
        let sum = parts.iter().fold(0.0, |sum, part| sum + part.1);
        if let Some(&(_, value)) = parts.iter().find(|part| !(0.0..=1.0).contains(&part.1)) {
            return Err(ControlError::Limit { name: "weight", value });
        }
        if (sum - 1.0).abs() > ROUNDING {
            return Err(ControlError::Weights { sum });
        }
        if guard.is_some() && parts.len() < 2 {
            return Err(ControlError::NothingToHandOverTo);
        }
        let Widths { observation: expected, action: takes, .. } = parts[0].0.widths();
        for (part, _) in &parts {
            let Widths { observation: got, action: gives, .. } = part.widths();
            if (got, gives) != (expected, takes) {
                return Err(ControlError::Widths { got, gives, expected, takes });
            }
        }
        Ok(Self { parts, guard })
    }

    /// Weight of a controller, for the share that the guard hands over.
    fn weight(&self, controller: usize, handed_over: f64) -> f32 {
        let moved = self.parts[0].1 * handed_over * [-1.0, 1.0].get(controller).unwrap_or(&0.0);
        (self.parts[controller].1 + moved) as f32
    }
}

impl Controller for Blend {
    fn widths(&self) -> Widths {
        let memory: usize = self.parts.iter().map(|(part, _)| part.widths().memory).sum();
        Widths { memory: memory + usize::from(self.guard.is_some()), ..self.parts[0].0.widths() }
    }

    fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        let mut layout: Vec<_> = self.parts.iter().flat_map(|(part, _)| part.memory_layout()).collect();
        layout.extend(self.guard.as_ref().map(|_| ("handed_over", 1)));
        layout
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        let Widths { observation, memory: width, action } = self.widths();
        self.widths().rows(observations, memory, actions)?;
        let shares = |guard: &Guard| observations.chunks_exact(observation).map(|row| guard.share(row)).collect();
        let shares: Vec<f64> = self.guard.as_ref().map_or(vec![0.0; actions.len() / action], shares);
        let (mut start, mut own) = (0, vec![0.0; actions.len()]);
        actions.fill(0.0);
        for (i, (part, _)) in self.parts.iter().enumerate() {
            let end = start + part.widths().memory;
            act_in_columns(&**part, observations, memory, width, start..end, &mut own)?;
            for (k, (sum, own)) in actions.chunks_exact_mut(action).zip(own.chunks_exact(action)).enumerate() {
                let weight = self.weight(i, shares[k]);
                sum.iter_mut().zip(own).for_each(|(sum, own)| *sum += weight * own.clamp(-1.0, 1.0));
            }
            start = end;
        }
        actions.iter_mut().for_each(|action| *action = action.clamp(-1.0, 1.0));
        if self.guard.is_some() {
            memory.chunks_exact_mut(width).zip(&shares).for_each(|(row, share)| row[width - 1] = *share);
        }
        Ok(())
    }
}

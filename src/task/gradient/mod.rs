//! Gradients through a control period without the physics: the kernels of a task over dual numbers.
//!
//! A control period has two parts around the physics. [`TaskKernel::act`] maps action and memory to forces;
//! `ControlInstant::evaluate` maps the next state and the memory to observation and reward. Both are products of a cotangent with a
//! Jacobian. Each pass of a kernel differentiates along one coordinate of the inputs, for the frames of one set of lanes.
//!
//! Coordinates of the memory are the rows that depend on states and actions: previous action, change, effort, integral of errors
//! (`EpisodeRows::action` to `EpisodeRows::means`), and the rows of `TaskRows::updated`. Target and references are functions of
//! time. Measurements are inputs of their own, as they may belong to an earlier state.

mod act;
mod evaluate;
mod frames;

use frames::check;
pub use frames::{Acted, Evaluated, GradientWidths};

use super::definition::{TaskDefinition, TaskKernel};
use super::kernel::Command;
use crate::control::ACTIONS;
use crate::error::TaskError;
use crate::lane::Rows;

/// Gradients through the kernels of a task. Numbers are by frames, (k, .).
///
/// # Errors
/// All products return `ControlError::Shape` for arrays of other lengths, and `SimulatorError::DerivativeLanes`.
pub trait TaskGradient {
    /// Numbers of coordinates.
    fn widths(&self) -> GradientWidths;
    /// Forces (k, f), and servo targets of the joints (k, 4 n): see [`Command`]. `TaskError::Action` for an action that is not
    /// finite.
    fn forces(&self, frames: &Acted<'_>) -> Result<[Vec<f64>; 2], TaskError>;
    /// Cotangents of `[action, base, memory]` before [`TaskKernel::act`] from the cotangents of `[force, memory]` after it.
    fn act_vjp(&self, frames: &Acted<'_>, cotangents: &[f64]) -> Result<Vec<f64>, TaskError>;
    /// Cotangents of `[state, measurement, memory]` before `ControlInstant::evaluate` from the cotangents of
    /// `[observation, reward, measurement, memory]` after it.
    fn evaluate_vjp(&self, frames: &Evaluated<'_>, cotangents: &[f64]) -> Result<Vec<f64>, TaskError>;
}

impl<K: TaskDefinition> TaskGradient for TaskKernel<f64, K> {
    fn widths(&self) -> GradientWidths {
        let (rows, n, coordinates) = (&self.rows, self.rows.joints, self.rows.coordinates);
        GradientWidths {
            state: 12 + 2 * coordinates,
            measurement: 12 + 2 * n + if K::OBSERVES_UP { 3 } else { 0 },
            memory: rows.means - rows.action + rows.task.updated[1],
            observation: self.observation_len(),
            action: rows.actions,
            force: self.actuation.thrusters() + if K::DRIVES_JOINTS { n } else { 0 },
            rows: rows.recorded(),
        }
    }

    fn forces(&self, frames: &Acted<'_>) -> Result<[Vec<f64>; 2], TaskError> {
        frames.check(&self.widths(), None)?;
        let a = self.rows.actions;
        if let Some(at) = frames.actions.iter().position(|action| !action.is_finite()) {
            return Err(TaskError::Action { instance: at / a, index: at % a, value: frames.actions[at] as f32 });
        }
        let (GradientWidths { rows, force, .. }, thrusters) = (self.widths(), self.actuation.thrusters());
        let (mut forces, mut targets, mut memory) = (Vec::new(), Vec::new(), Vec::new());
        for (i, actions) in frames.actions.chunks_exact(a).enumerate() {
            memory.clear();
            memory.extend(frames.memory[i * rows..][..rows].iter().map(|x| f64::from(*x)));
            let (mut action, mut base, mut command) = ([0.0; ACTIONS], [0.0; ACTIONS], Command::none());
            action[..a].copy_from_slice(actions);
            base[..a].copy_from_slice(&frames.base.unwrap_or(frames.actions)[i * a..][..a]);
            self.actions().act(&mut Rows::of_one(&mut memory), &mut action, frames.base.map(|_| &base), &mut command);
            forces.extend(&command.actuated.thrusts[..thrusters]);
            forces.extend(&command.actuated.torques[..force - thrusters]);
            targets.extend(command.joints[..self.rows.joints].as_flattened());
        }
        Ok([forces, targets])
    }

    fn act_vjp(&self, frames: &Acted<'_>, cotangents: &[f64]) -> Result<Vec<f64>, TaskError> {
        let widths = self.widths();
        frames.check(&widths, Some(cotangents))?;
        Ok(act::act_vjp(self.actions(), widths, frames, cotangents))
    }

    fn evaluate_vjp(&self, frames: &Evaluated<'_>, cotangents: &[f64]) -> Result<Vec<f64>, TaskError> {
        let (widths, k) = (self.widths(), frames.fresh.len());
        let outputs = widths.observation + 1 + widths.measurement + widths.memory;
        check(&[
            ("states", frames.states.len(), k * widths.state_numbers()),
            ("memories", frames.memory.len(), k * widths.rows),
            ("before", frames.before.len(), k * widths.rows),
            ("cotangents", cotangents.len(), k * outputs),
        ])?;
        Ok(evaluate::evaluate_vjp(self, widths, frames, cotangents))
    }
}

//! A network as plain data.

use serde::{Deserialize, Serialize};

use crate::error::PolicyError;

/// Function between layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Activation {
    /// Hyperbolic tangent, the default of Stable-Baselines3's on-policy algorithms.
    #[default]
    Tanh,
    /// `max(x, 0)`.
    Relu,
    /// `x` where positive, else `exp(x) - 1`.
    Elu,
}

/// Function after the last layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Output {
    /// Clipped to [-1, 1].
    #[default]
    Clip,
    /// Hyperbolic tangent, as in SAC.
    Tanh,
}

/// `y = W x + b`.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// W row by row: one row per output, as in torch.
    pub weights: Vec<f32>,
    /// b, one per output.
    pub biases: Vec<f32>,
}

impl Layer {
    /// Entries of y.
    pub fn outputs(&self) -> usize {
        self.biases.len()
    }

    /// Entries of x.
    pub fn inputs(&self) -> usize {
        self.weights.len() / self.biases.len().max(1)
    }
}

/// Normalisation of observations, as in Stable-Baselines3's VecNormalize:
/// `clip((x - mean) / sqrt(variance + epsilon), -clip, clip)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Normalisation {
    /// Mean of each entry.
    pub mean: Vec<f32>,
    /// Variance of each entry.
    pub variance: Vec<f32>,
    /// Added to the variance.
    pub epsilon: f32,
    /// Maximum magnitude of the result.
    pub clip: f32,
}

/// Layers with an activation between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    /// Number of stacked observations: the last ones, oldest first, and zeros before an episode's first (as in
    /// Stable-Baselines3's `VecFrameStack`). Usually 1.
    pub history: usize,
    /// Before the first layer.
    pub normalisation: Option<Normalisation>,
    /// At least one.
    pub layers: Vec<Layer>,
    /// After every layer but the last.
    pub activation: Activation,
    /// After the last.
    pub output: Output,
}

impl Network {
    /// Entries of an observation.
    pub fn observation_len(&self) -> usize {
        self.inputs() / self.history.max(1)
    }

    /// Entries of its input.
    pub fn inputs(&self) -> usize {
        self.layers.first().map_or(0, Layer::inputs)
    }

    /// Entries of an action.
    pub fn outputs(&self) -> usize {
        self.layers.last().map_or(0, Layer::outputs)
    }

    /// Entries of its input, and of all layers' results.
    pub fn sizes(&self) -> Vec<usize> {
        std::iter::once(self.inputs()).chain(self.layers.iter().map(Layer::outputs)).collect()
    }

    /// Refuses layers that do not fit together, and numbers that are not finite.
    pub(super) fn check(&self) -> Result<(), PolicyError> {
        if self.layers.is_empty() {
            return Err(PolicyError::NoLayers);
        }
        let mut inputs = self.inputs();
        if self.history == 0 || !inputs.is_multiple_of(self.history) {
            return Err(PolicyError::History { history: self.history, inputs });
        }
        for (i, layer) in self.layers.iter().enumerate() {
            let (got, expected) = (layer.weights.len(), layer.outputs() * inputs);
            if got != expected || got == 0 {
                return Err(PolicyError::Layer { layer: i, outputs: layer.outputs(), inputs, got });
            }
            finite(&format!("layers.{i}.weight"), &layer.weights)?;
            finite(&format!("layers.{i}.bias"), &layer.biases)?;
            inputs = layer.outputs();
        }
        if let Some(Normalisation { mean, variance, epsilon, clip }) = &self.normalisation {
            for (tensor, values) in [("observation.mean", mean), ("observation.variance", variance)] {
                if values.len() != self.inputs() {
                    let (got, expected) = (values.len(), self.inputs());
                    return Err(PolicyError::Length { tensor: tensor.into(), got, expected });
                }
                finite(tensor, values)?;
            }
            let minimum = variance.iter().copied().fold(f32::INFINITY, f32::min) + epsilon;
            for (name, value) in [("variance + epsilon", minimum), ("clip", *clip)] {
                if !(value > 0.0 && value.is_finite()) {
                    return Err(PolicyError::Number { name, value, rule: "positive and finite" });
                }
            }
        }
        Ok(())
    }
}

fn finite(tensor: &str, values: &[f32]) -> Result<(), PolicyError> {
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(index) => Err(PolicyError::NotFinite { tensor: tensor.to_owned(), index, value: values[index] }),
    }
}

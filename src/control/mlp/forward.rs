//! The forward pass: lanes over instances, weights broadcast.
//!
//! Each output is one chain of multiply-adds from its bias on, in the order of the inputs, so that its bits depend
//! neither on the lanes' width nor on the number of instances.

use super::network::{Activation, Network, Output};
use crate::lane::{Kernel, Lane, tanh};

/// Instances per panel: a multiple of twice the widest lane.
const PANEL: usize = 32;
/// Outputs computed side by side, so that every number read is used several times and the adders stay busy.
const TILE: usize = 4;
/// Lanes side by side.
const PAIR: usize = 2;

/// One number of each instance of a panel.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
struct Panel([f32; PANEL]);

/// A layer with its weights in the order of their use; outputs are padded with zeros to a multiple of a tile.
#[derive(Debug, Clone)]
struct PackedLayer {
    inputs: usize,
    /// Biases by tile.
    biases: Vec<[f32; TILE]>,
    /// Weights by tile and input.
    weights: Vec<[f32; TILE]>,
}

/// A network packed for the forward pass.
#[derive(Debug, Clone)]
pub(super) struct Packed {
    inputs: usize,
    outputs: usize,
    /// Per input: mean and factor; and the bound.
    normalisation: Option<(Vec<[f32; 2]>, f32)>,
    layers: Vec<PackedLayer>,
    activation: Activation,
    output: Output,
}

impl Packed {
    /// Packs a checked network.
    pub fn new(network: &Network) -> Self {
        let normalisation = network.normalisation.as_ref().map(|n| {
            let factor = |v: f32| (1.0 / (f64::from(v) + f64::from(n.epsilon)).sqrt()) as f32;
            (n.mean.iter().zip(&n.variance).map(|(&mean, &v)| [mean, factor(v)]).collect(), n.clip)
        });
        let pack = |layer: &super::Layer| {
            let (inputs, outputs) = (layer.inputs(), layer.outputs());
            let tiles = outputs.div_ceil(TILE);
            let bias = |o: usize| layer.biases.get(o).copied().unwrap_or(0.0);
            let weight = |o: usize, i: usize| if o < outputs { layer.weights[o * inputs + i] } else { 0.0 };
            PackedLayer {
                inputs,
                biases: (0..tiles).map(|t| std::array::from_fn(|r| bias(t * TILE + r))).collect(),
                weights: (0..tiles * inputs)
                    .map(|at| std::array::from_fn(|r| weight(at / inputs * TILE + r, at % inputs)))
                    .collect(),
            }
        };
        Self {
            inputs: network.inputs(),
            outputs: network.outputs(),
            normalisation,
            layers: network.layers.iter().map(pack).collect(),
            activation: network.activation,
            output: network.output,
        }
    }

    /// Number of panels for the input or result of any layer.
    fn height(&self) -> usize {
        self.layers.iter().map(|layer| layer.inputs.max(layer.biases.len() * TILE)).max().unwrap_or(0)
    }
}

pub(super) struct Forward<'a> {
    packed: &'a Packed,
    observations: &'a [f32],
    actions: &'a mut [f32],
    /// After the last layer, if anything.
    output: Option<Output>,
    input: Vec<Panel>,
    result: Vec<Panel>,
}

impl<'a> Forward<'a> {
    /// Actions (n x outputs) for observations (n x inputs).
    pub fn new(packed: &'a Packed, observations: &'a [f32], actions: &'a mut [f32]) -> Self {
        Self { output: Some(packed.output), ..Self::of_last_layer(packed, observations, actions) }
    }

    /// Numbers of the last layer (n x outputs) for observations (n x inputs).
    pub fn of_last_layer(packed: &'a Packed, observations: &'a [f32], actions: &'a mut [f32]) -> Self {
        let panels = vec![Panel([0.0; PANEL]); packed.height()];
        Self { packed, observations, actions, output: None, input: panels.clone(), result: panels }
    }
}

impl Kernel<f32> for Forward<'_> {
    #[inline(always)]
    fn run<L: Lane<Real = f32>>(&mut self) {
        let Packed { inputs, outputs, .. } = *self.packed;
        let count = self.observations.len() / inputs;
        for first in (0..count).step_by(PANEL) {
            let (mut input, mut result) = (&mut self.input[..], &mut self.result[..]);
            let rows = PANEL.min(count - first);
            for j in 0..rows {
                let row = &self.observations[(first + j) * inputs..][..inputs];
                for k in 0..inputs {
                    input[k].0[j] = row[k];
                }
            }
            // Lanes with instances, rounded up to pairs; the others are not read.
            let used = rows.next_multiple_of(PAIR * L::LANES);
            if let Some((entries, clip)) = &self.packed.normalisation {
                normalise::<L>(&mut input[..inputs], entries, *clip);
            }
            for (k, layer) in self.packed.layers.iter().enumerate() {
                let last = k + 1 == self.packed.layers.len();
                for at in (0..used).step_by(PAIR * L::LANES) {
                    layer.multiply::<L>(&input[..layer.inputs], result, at);
                }
                let function = match (last, self.packed.activation, self.output) {
                    (false, Activation::Tanh, _) | (true, _, Some(Output::Tanh)) => Some(Function::Tanh),
                    (false, Activation::Relu, _) => Some(Function::Relu),
                    (false, Activation::Elu, _) => Some(Function::Elu),
                    (true, _, Some(Output::Clip)) => Some(Function::Clip),
                    (true, _, None) => None,
                };
                if let Some(function) = function {
                    for panel in &mut result[..layer.biases.len() * TILE] {
                        for at in (0..used).step_by(L::LANES) {
                            function.at(L::load(&panel.0[at..])).store(&mut panel.0[at..]);
                        }
                    }
                }
                (input, result) = (result, input);
            }
            for j in 0..rows {
                let row = &mut self.actions[(first + j) * outputs..][..outputs];
                for k in 0..outputs {
                    row[k] = input[k].0[j];
                }
            }
        }
    }
}

impl PackedLayer {
    /// `W x + b` of two lanes of instances that begin at `at`.
    #[inline(always)]
    fn multiply<L: Lane<Real = f32>>(&self, input: &[Panel], result: &mut [Panel], at: usize) {
        for tile in 0..self.biases.len() {
            let weights = &self.weights[tile * self.inputs..][..self.inputs];
            let input = &input[..weights.len()];
            let (biases, rows) = (&self.biases[tile], &mut result[tile * TILE..][..TILE]);
            let mut sums = [[L::zero(); PAIR]; TILE];
            for r in 0..TILE {
                sums[r] = [L::splat(biases[r]); PAIR];
            }
            for k in 0..weights.len() {
                let x = [L::load(&input[k].0[at..]), L::load(&input[k].0[at + L::LANES..])];
                for r in 0..TILE {
                    let w = L::splat(weights[k][r]);
                    for g in 0..PAIR {
                        sums[r][g] = x[g].mul_add(w, sums[r][g]);
                    }
                }
            }
            for r in 0..TILE {
                for g in 0..PAIR {
                    sums[r][g].store(&mut rows[r].0[at + g * L::LANES..]);
                }
            }
        }
    }
}

#[inline(always)]
fn normalise<L: Lane<Real = f32>>(panels: &mut [Panel], entries: &[[f32; 2]], clip: f32) {
    let bound = L::splat(clip);
    for k in 0..entries.len() {
        let ([mean, factor], panel) = (entries[k], &mut panels[k].0);
        for at in (0..PANEL).step_by(L::LANES) {
            let scaled = (L::load(&panel[at..]) - L::splat(mean)) * L::splat(factor);
            scaled.min(bound).max(-bound).store(&mut panel[at..]);
        }
    }
}

#[derive(Debug, Clone, Copy)]
enum Function {
    Tanh,
    Relu,
    Elu,
    Clip,
}

impl Function {
    #[inline(always)]
    fn at<L: Lane<Real = f32>>(self, x: L) -> L {
        match self {
            Self::Tanh => tanh(x),
            Self::Relu => x.max(L::zero()),
            // `exp(x) - 1 = 2 t / (1 - t)` with `t = tanh(x / 2)`.
            Self::Elu => {
                let t = tanh(x.min(L::zero()) * L::c(0.5));
                L::select(L::zero().lt(x), x, (t + t) / (L::c(1.0) - t))
            }
            Self::Clip => x.min(L::c(1.0)).max(L::c(-1.0)),
        }
    }
}

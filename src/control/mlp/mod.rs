//! Neural policies: multilayer perceptrons, as Stable-Baselines3 trains them.

mod file;
mod forward;
mod network;
mod spec;

use std::collections::BTreeMap;

pub use network::{Activation, Layer, Network, Normalisation, Output};
pub use spec::PolicySpec;

use super::controller::{Controller, Widths};
use crate::error::{ControlError, PolicyError};
use crate::lane::{Isa, Real};
use forward::{Forward, Packed};

/// Multilayer perceptron in single precision, one lane per instance.
#[derive(Debug, Clone)]
pub struct Mlp {
    network: Network,
    spec: Option<PolicySpec>,
    notes: BTreeMap<String, String>,
    packed: Packed,
    isa: Isa,
}

impl Mlp {
    /// The policy of a network; `spec` is its environment, `notes` are free text.
    ///
    /// # Errors
    /// `PolicyError` where layers do not fit together or to the spec, or a number is not finite.
    pub fn new(
        network: Network,
        spec: Option<PolicySpec>,
        notes: BTreeMap<String, String>,
    ) -> Result<Self, PolicyError> {
        network.check()?;
        if let Some(spec) = &spec {
            spec.check_widths(network.observation_len(), network.outputs())?;
        }
        let packed = Packed::new(&network);
        Ok(Self { network, spec, notes, packed, isa: Isa::best()? })
    }

    /// The network.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// Environment of the policy, if known.
    pub fn spec(&self) -> Option<&PolicySpec> {
        self.spec.as_ref()
    }

    /// Notes: seeds, steps, scores.
    pub fn notes(&self) -> &BTreeMap<String, String> {
        &self.notes
    }

    /// Refuses another environment. Without a spec only the numbers of entries must match.
    ///
    /// # Errors
    /// `PolicyError` names the first difference.
    pub fn check(&self, environment: &PolicySpec) -> Result<(), PolicyError> {
        if let Some(own) = &self.spec {
            own.check(environment)?;
        }
        environment.check_widths(self.network.observation_len(), self.network.outputs())
    }

    /// Numbers of the last layer (n x a), before they are clipped or squashed, for stacked observations (n x h d): the mean
    /// of the actions in training.
    ///
    /// # Panics
    /// Lengths differ from n rows.
    pub fn mean(&self, inputs: &[f32], mean: &mut [f32]) {
        f32::dispatch(self.isa, &mut Forward::of_last_layer(&self.packed, inputs, mean));
    }

    /// The same policy on lanes of `isa`.
    #[must_use]
    pub fn on(self, isa: Isa) -> Self {
        Self { isa, ..self }
    }
}

impl Controller for Mlp {
    fn widths(&self) -> Widths {
        let (inputs, observation) = (self.network.inputs(), self.network.observation_len());
        Widths { observation, memory: inputs - observation, action: self.network.outputs() }
    }

    fn memory_layout(&self) -> Vec<(&'static str, usize)> {
        vec![("history", self.widths().memory)]
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().rows(observations, memory, actions)?;
        if memory.is_empty() {
            f32::dispatch(self.isa, &mut Forward::new(&self.packed, observations, actions));
            return Ok(());
        }
        let Widths { observation, memory: before, .. } = self.widths();
        let mut inputs = Vec::with_capacity(observations.len() + memory.len());
        for (memory, row) in memory.chunks_exact_mut(before).zip(observations.chunks_exact(observation)) {
            inputs.extend(memory.iter().map(|x| *x as f32));
            inputs.extend(row);
            memory.copy_within(observation.., 0);
            memory[before - observation..].iter_mut().zip(row).for_each(|(old, new)| *old = f64::from(*new));
        }
        f32::dispatch(self.isa, &mut Forward::new(&self.packed, &inputs, actions));
        Ok(())
    }
}

//! Policies as safetensors files.
//!
//! Tensors, all F32: `layers.K.weight` (outputs, inputs) and `layers.K.bias` (outputs), K = 0, 1, ...; with
//! normalisation `observation.mean` and `observation.variance` (inputs). The file's metadata has one entry,
//! `uvms_gym`: a JSON object with everything else, in a fixed order, so that equal policies make equal files.

use std::collections::BTreeMap;

use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensors, serialize};
use serde::{Deserialize, Serialize};

use super::{Activation, Layer, Mlp, Network, Normalisation, Output, PolicySpec};
use crate::error::PolicyError;

/// Key of the metadata.
const KEY: &str = "uvms_gym";
/// Version of the form.
const FORM: &str = "mlp/1";

/// Metadata entry.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    form: String,
    /// As the tensors' shapes.
    sizes: Vec<usize>,
    activation: Activation,
    output: Output,
    #[serde(default = "one")]
    history: usize,
    normalisation: Option<Bounds>,
    // The key in shipped files, whose digests are recorded beside results.
    #[serde(rename = "purpose")]
    spec: Option<PolicySpec>,
    #[serde(default)]
    notes: BTreeMap<String, String>,
}

fn one() -> usize {
    1
}

/// Scalars of a normalisation.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Bounds {
    epsilon: f32,
    clip: f32,
}

impl Mlp {
    /// The policy as a file.
    ///
    /// # Errors
    /// `PolicyError::File` if notes are too long for the format.
    pub fn to_bytes(&self) -> Result<Vec<u8>, PolicyError> {
        let network = &self.network;
        let header = Header {
            form: FORM.into(),
            sizes: network.sizes(),
            activation: network.activation,
            output: network.output,
            history: network.history,
            normalisation: network.normalisation.as_ref().map(|n| Bounds { epsilon: n.epsilon, clip: n.clip }),
            spec: self.spec.clone(),
            notes: self.notes.clone(),
        };
        let mut tensors: Vec<(String, Vec<usize>, &[f32])> = Vec::new();
        for (k, layer) in network.layers.iter().enumerate() {
            tensors.push((format!("layers.{k}.weight"), vec![layer.outputs(), layer.inputs()], &layer.weights));
            tensors.push((format!("layers.{k}.bias"), vec![layer.outputs()], &layer.biases));
        }
        if let Some(n) = &network.normalisation {
            tensors.push(("observation.mean".into(), vec![n.mean.len()], &n.mean));
            tensors.push(("observation.variance".into(), vec![n.variance.len()], &n.variance));
        }
        let bytes: Vec<Vec<u8>> =
            tensors.iter().map(|(.., numbers)| numbers.iter().flat_map(|x| x.to_le_bytes()).collect()).collect();
        let wrong = |error: &dyn std::fmt::Display| PolicyError::File(error.to_string());
        let mut views = Vec::with_capacity(tensors.len());
        for ((name, shape, _), bytes) in tensors.into_iter().zip(&bytes) {
            views.push((name, TensorView::new(Dtype::F32, shape, bytes).map_err(|e| wrong(&e))?));
        }
        let text = serde_json::to_string(&header).map_err(|e| wrong(&e))?;
        serialize(views, Some(std::iter::once((KEY.to_owned(), text)).collect())).map_err(|e| wrong(&e))
    }

    /// The policy of a file.
    ///
    /// # Errors
    /// `PolicyError::File` for another kind of file or a truncated one; otherwise as [`Mlp::new`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, PolicyError> {
        let file = |error: String| PolicyError::File(error);
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| file(e.to_string()))?;
        let tensors = SafeTensors::deserialize(bytes).map_err(|e| file(e.to_string()))?;
        let text = metadata.metadata().as_ref().and_then(|entries| entries.get(KEY));
        let text = text.ok_or_else(|| file(format!("its metadata lack the entry '{KEY}'")))?;
        let form = serde_json::from_str::<BTreeMap<String, serde_json::Value>>(text);
        let form = form.ok().and_then(|entries| entries.get("form").cloned());
        if form.as_ref().and_then(|form| form.as_str()) != Some(FORM) {
            let form = form.map_or_else(|| "none".into(), |form| form.to_string());
            return Err(file(format!("its form is {form}, but must be \"{FORM}\"")));
        }
        let header: Header = serde_json::from_str(text).map_err(|e| file(format!("metadata '{KEY}': {e}")))?;

        let mut names = Vec::new();
        let mut read = |name: String, shape: &[usize]| {
            let tensor = tensors.tensor(&name).map_err(|_| file(format!("it lacks the tensor '{name}'")))?;
            if tensor.dtype() != Dtype::F32 || tensor.shape() != shape {
                let (dtype, got) = (tensor.dtype(), tensor.shape());
                return Err(file(format!("tensor '{name}' is {dtype} {got:?}, but its sizes ask for F32 {shape:?}")));
            }
            names.push(name);
            let (numbers, _) = tensor.data().as_chunks::<4>();
            Ok(numbers.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect::<Vec<f32>>())
        };
        let inputs = header.sizes.first().copied().unwrap_or(0);
        let normalisation = match header.normalisation {
            None => None,
            Some(Bounds { epsilon, clip }) => Some(Normalisation {
                mean: read("observation.mean".into(), &[inputs])?,
                variance: read("observation.variance".into(), &[inputs])?,
                epsilon,
                clip,
            }),
        };
        let mut layers = Vec::new();
        for (k, pair) in header.sizes.windows(2).enumerate() {
            layers.push(Layer {
                weights: read(format!("layers.{k}.weight"), &[pair[1], pair[0]])?,
                biases: read(format!("layers.{k}.bias"), &[pair[1]])?,
            });
        }
        if let Some(name) = tensors.names().into_iter().find(|name| !names.iter().any(|known| known == name)) {
            return Err(file(format!("it has a tensor '{name}', which its sizes do not ask for")));
        }
        let Header { activation, output, history, .. } = header;
        let network = Network { history, normalisation, layers, activation, output };
        Self::new(network, header.spec, header.notes)
    }
}

//! Scenes with other numbers at given keys.

use toml::Value;

use super::{Scene, path};
use crate::error::{DescriptionError, Problem};
use crate::keys::Fault;

/// Makes scenes that differ from one scene in the values of keys.
#[derive(Debug, Clone)]
pub struct SceneEditor {
    scene: Scene,
    tree: Value,
    keys: Vec<String>,
}

impl SceneEditor {
    /// Editor of the values of these keys (example: `arm.links[0].body.mass`, `arm.links[elbow].joint.friction.viscous`).
    ///
    /// Stated weights, which only repeat mass and gravity, are left out of the scenes unless a key is one of them.
    ///
    /// # Errors
    /// [`DescriptionError::Value`] for a key for which the scene has no place; it names the most similar key.
    pub fn new(scene: &Scene, keys: Vec<String>) -> Result<Self, DescriptionError> {
        let mut scene = scene.clone();
        if !keys.iter().any(|key| key.ends_with(".weight")) {
            scene.bodies_mut().for_each(|body| body.weight = None);
        }
        let tree = scene.to_tree();
        for key in &keys {
            if !path::set(&mut tree.clone(), key, Value::Float(0.0)) {
                return Err(unknown(key, &tree).in_source(format!("scene '{}'", scene.name), &tree));
            }
        }
        Ok(Self { scene, tree, keys })
    }

    /// Name of the scene.
    pub fn name(&self) -> &str {
        &self.scene.name
    }

    /// The scene's value of a key, if it has any.
    pub fn value(&self, key: &str) -> Option<Value> {
        path::resolve(&self.tree, key).map(|(_, value)| value.clone())
    }

    /// The scene with `values` of the keys, in their order; `source_name` appears in errors.
    ///
    /// # Errors
    /// As [`Scene::from_value`].
    pub fn edited(
        &self,
        values: impl IntoIterator<Item = Value>,
        source_name: &str,
    ) -> Result<Scene, DescriptionError> {
        let mut tree = self.tree.clone();
        for (key, value) in self.keys.iter().zip(values) {
            path::set(&mut tree, key, value);
        }
        let mut scene = Scene::from_value(tree, source_name).map_err(|error| match error {
            DescriptionError::Value { source_name, key, problem: Problem::UnknownKey { .. } } => {
                unknown(&key, &self.tree).in_source(source_name, &self.tree)
            }
            error => error,
        })?;
        scene.provenance.clone_from(&self.scene.provenance);
        Ok(scene)
    }
}

/// The fault of a key that is not in the scene.
fn unknown(key: &str, tree: &Value) -> Fault {
    let known = path::keys(tree);
    let nearest = known.into_iter().min_by_key(|known| distance(key, known)).unwrap_or_default();
    Fault::new(key, Problem::NoSuchKey { nearest })
}

/// Number of characters to insert, remove or replace that turns one text into another.
fn distance(one: &str, other: &str) -> usize {
    let other: Vec<char> = other.chars().collect();
    let mut row: Vec<usize> = (0..=other.len()).collect();
    for (i, a) in one.chars().enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], i + 1);
        for (k, b) in other.iter().enumerate() {
            let replaced = diagonal + usize::from(a != *b);
            diagonal = row[k + 1];
            row[k + 1] = replaced.min(row[k] + 1).min(diagonal + 1);
        }
    }
    row[other.len()]
}

//! Scenes of episodes: numbers drawn from ranges.

use toml::Value;

use super::disturbance::{Parameters, SceneRange};
use super::random::{EpisodeKey, Purpose, Stream};
use crate::description::{Scene, SceneEditor};
use crate::error::TaskError;
use crate::system::{Compiled, InstanceSystem, compile, structural_difference};

/// Draws of an episode until one is a scene.
const ATTEMPTS: u32 = 64;
/// Numbers of a draw.
const NUMBERS: u32 = 1 << 16;
/// Draws that are tried beforehand.
const SAMPLES: u64 = 16;

/// Scenes of episodes, which differ in the numbers that are drawn.
#[derive(Debug, Clone)]
pub struct SceneDraws {
    editor: SceneEditor,
    /// The scene's values of the keys, and their ranges.
    ranges: Vec<(Value, SceneRange)>,
    joints: Vec<String>,
    samples: Vec<(Scene, Compiled)>,
}

impl SceneDraws {
    /// Draws of the numbers of `scene` that `parameters` randomises; none where these are only factors.
    ///
    /// # Errors
    /// [`TaskError::Disturbance`] for a key that the scene does not have or that has no effect, a range of another form than the
    /// scene's value, and where fewer than half of the draws are scenes.
    pub fn new(scene: &Scene, parameters: &Parameters) -> Result<Option<Self>, TaskError> {
        if parameters.scene().is_empty() {
            return Ok(None);
        }
        let refuse = |key: &str, reason: String| TaskError::Disturbance { key: format!("randomize: {key}"), reason };
        let editor = |keys: Vec<String>| SceneEditor::new(scene, keys).map_err(|error| error.to_string());
        let mut ranges = Vec::new();
        for (key, range) in parameters.scene() {
            let one = editor(vec![key.clone()]).map_err(|reason| refuse(key, reason))?;
            let value = match (one.value(key), range.zeros()) {
                (Some(value), _) => value,
                (None, Some(zeros)) => {
                    let middle = range.draw(&zeros, &mut || 0.5);
                    one.edited([middle], scene.name.as_str()).map_err(|error| refuse(key, error.to_string()))?;
                    zeros
                }
                (None, None) => return Err(refuse(key, "the scene has no value there: give a range".into())),
            };
            if let Err(reason) = range.check(&value) {
                return Err(refuse(key, reason));
            }
            ranges.push((value, range.clone()));
        }
        let keys: Vec<String> = parameters.scene().keys().cloned().collect();
        let editor = editor(keys.clone()).map_err(|reason| refuse("scene", reason))?;
        let mut draws = Self { editor, ranges, joints: scene.joint_keys(), samples: Vec::new() };
        let mut fault = String::new();
        let keys_of_samples = (0..SAMPLES).map(|episode| EpisodeKey { seed: u64::MAX, episode });
        for key in keys_of_samples {
            match draws.attempt(key, 0) {
                Ok(sample) => draws.samples.push(sample),
                Err(reason) => fault = reason,
            }
        }
        if draws.samples.len() < SAMPLES as usize / 2 {
            return Err(refuse("fewer than half of the draws make a scene", fault));
        }
        draws.check_effects(&keys).map_err(|key| {
            let reason = "has no effect on the motion in episodes, as a thruster without dynamics, a home or a current";
            refuse(&key, reason.into())
        })?;
        Ok(Some(draws))
    }

    /// The first key whose numbers the physics does not read.
    fn check_effects(&self, keys: &[String]) -> Result<(), String> {
        let (scene, compiled) = &self.samples[0];
        for (key, (value, _)) in keys.iter().zip(&self.ranges) {
            let editor = SceneEditor::new(scene, vec![key.clone()]).map_err(|_| key.clone())?;
            let other = editor.edited([value.clone()], "").map_err(|_| key.clone());
            let differs = editor.value(key).as_ref() != Some(value);
            if differs
                && let Ok(other) = other
                && InstanceSystem::from(&compile(&other)) == InstanceSystem::from(compiled)
            {
                return Err(key.clone());
            }
        }
        Ok(())
    }

    /// Compiled samples, which differ in every number that draws change.
    pub fn samples(&self) -> Vec<Compiled> {
        self.samples.iter().map(|(_, compiled)| compiled.clone()).collect()
    }

    /// The scene of an episode, and the same compiled. A draw that no physical scene has is drawn again.
    pub fn draw(&self, key: EpisodeKey) -> (Scene, Compiled) {
        let mut attempts = (0..ATTEMPTS).filter_map(|attempt| self.attempt(key, attempt).ok());
        attempts.next().unwrap_or_else(|| self.samples[0].clone())
    }

    fn attempt(&self, key: EpisodeKey, attempt: u32) -> Result<(Scene, Compiled), String> {
        let stream = Stream::new(key, Purpose::SCENE);
        let mut index = attempt * NUMBERS;
        let values: Vec<Value> = self
            .ranges
            .iter()
            .map(|(value, range)| {
                range.draw(value, &mut || {
                    index += 1;
                    stream.uniform(index - 1)
                })
            })
            .collect();
        let scene = self.editor.edited(values, "draw").map_err(|error| error.to_string())?;
        let compiled = compile(&scene);
        let difference =
            self.samples.first().and_then(|(_, first)| structural_difference(first, &compiled, &self.joints));
        difference.map_or(Ok((scene, compiled)), |place| Err(format!("scenes of different structure: {place}")))
    }
}

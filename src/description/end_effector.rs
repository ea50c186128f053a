//! End effectors: frames on bodies of the arm, and the choice of one of them.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{Arm, BASE, Body, Frame, Joint, Link, Parent, Payload, Scene, VEHICLE};
use crate::error::DescriptionError;
use crate::keys::{Fault, none_of, numbers};

/// Name of the scene's own `arm.end_effector` among the named ones.
pub const DEFAULT_END_EFFECTOR: &str = "default";

/// A frame on a body of the arm.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EndEffectorFrame {
    /// Link that carries it, `base` or `vehicle`; the last link if absent, or the base of an arm without links.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub on: Option<String>,
    /// Origin in the frame of this body, m.
    #[serde(default, with = "numbers::vector3")]
    pub position: Vector3<f64>,
    /// Roll, pitch, yaw about the axes of this body, rad, as in [`Frame`].
    #[serde(default, with = "numbers::vector3")]
    pub rpy: Vector3<f64>,
}

impl EndEffectorFrame {
    /// Its pose in the frame of the body that carries it.
    pub fn frame(&self) -> Frame {
        Frame { position: self.position, rpy: self.rpy }
    }
}

impl From<Frame> for EndEffectorFrame {
    fn from(Frame { position, rpy }: Frame) -> Self {
        Self { on: None, position, rpy }
    }
}

impl Arm {
    /// End effector of this name, if there is one.
    pub fn end_effector_named(&self, name: &str) -> Option<&EndEffectorFrame> {
        let own = (name == DEFAULT_END_EFFECTOR).then_some(&self.end_effector);
        self.end_effectors.get(name).or(own)
    }

    /// End effector that carries the payload.
    pub fn payload_end_effector(&self, payload: &Payload) -> &EndEffectorFrame {
        payload.on.as_ref().and_then(|name| self.end_effector_named(name)).unwrap_or(&self.end_effector)
    }

    /// Fixes a body to the end effector in use, as a further link.
    pub(super) fn attach(&mut self, body: Body) {
        let name = |of: &EndEffectorFrame| match self.carrier(of) {
            Some(Parent::Link(k)) => self.links[k].name.clone(),
            Some(Parent::Base) => BASE.to_owned(),
            Some(Parent::Vehicle) | None => VEHICLE.to_owned(),
        };
        // The last link is another one from here on.
        let (own, named) = (name(&self.end_effector), self.end_effectors.values().map(name).collect::<Vec<_>>());
        self.end_effectors.values_mut().zip(named).for_each(|(of, name)| of.on = Some(name));
        self.end_effector.on = Some(own.clone());
        let (name, joint) = ("attached".to_owned(), Joint::fixed(self.end_effector.frame()));
        self.links.push(Link { name, parent: Some(own), joint, body: Some(body), meshes: Vec::new() });
    }

    /// True where both end effectors are the same frame of the same body.
    pub(super) fn coincide(&self, one: &EndEffectorFrame, other: &EndEffectorFrame) -> bool {
        self.carrier(one) == self.carrier(other) && one.frame() == other.frame()
    }

    /// Name of the end effector in use.
    pub fn end_effector_name(&self) -> &str {
        let same = |(_, named): &(&String, &EndEffectorFrame)| self.coincide(named, &self.end_effector);
        self.end_effectors.iter().find(same).map_or(DEFAULT_END_EFFECTOR, |(name, _)| name)
    }
}

impl Scene {
    /// Names of the end effectors, in alphabetical order; `default` is the scene's own where it is none of the others.
    pub fn end_effector_names(&self) -> Vec<String> {
        let Some(arm) = &self.arm else { return vec![DEFAULT_END_EFFECTOR.to_owned()] };
        let mut names: Vec<String> = arm.end_effectors.keys().cloned().collect();
        if !arm.end_effectors.contains_key(arm.end_effector_name()) {
            names.insert(0, DEFAULT_END_EFFECTOR.to_owned());
        }
        names
    }

    /// The scene that uses the end effector of this name. Everything else stays: the payload remains where it is, and the end
    /// effector of before keeps a name, `default` if it has none.
    ///
    /// # Errors
    /// [`DescriptionError::Value`] for an unknown name; it lists the known ones.
    pub fn with_end_effector(&self, name: &str) -> Result<Self, DescriptionError> {
        let unknown = |fault: Fault| fault.in_source(format!("scene '{}'", self.name), &self.to_tree());
        self.check_end_effector(name, "end_effector").map_err(unknown)?;
        let mut scene = self.clone();
        let Some(arm) = &mut scene.arm else { return Ok(scene) };
        let chosen = arm.end_effector_named(name).cloned().unwrap_or_default();
        if arm.coincide(&chosen, &arm.end_effector) {
            return Ok(scene);
        }
        let before = arm.end_effector_name().to_owned();
        let own = std::mem::replace(&mut arm.end_effector, chosen);
        arm.end_effectors.entry(before.clone()).or_insert(own);
        if let Some(payload) = &mut scene.payload {
            payload.on.get_or_insert(before);
        }
        Ok(scene)
    }

    /// A fault for a name that is no end effector's.
    pub(super) fn check_end_effector(&self, name: &str, key: &str) -> Result<(), Fault> {
        let known = match &self.arm {
            Some(arm) => arm.end_effector_named(name).is_some(),
            None => name == DEFAULT_END_EFFECTOR,
        };
        if known {
            return Ok(());
        }
        let names = self.end_effector_names();
        Err(none_of(name, "end effectors", names.iter().map(String::as_str), key))
    }
}

//! Scenes of single instances.

use std::borrow::Cow;

use super::Simulator;
use crate::control::Allocation;
use crate::description::Scene;
use crate::system::{Compiled, compile};

impl Simulator {
    /// Scenes of all instances, where they differ.
    pub fn scenes(&self) -> Option<&[Scene]> {
        self.own.as_ref().map(|own| own.scenes())
    }

    /// Scene of instance `i`.
    pub fn scene_of(&self, i: usize) -> &Scene {
        self.scenes().map_or(&self.scene, |scenes| &scenes[i])
    }

    /// Scene of instance `i`, compiled.
    pub(super) fn compiled_of(&self, i: usize) -> Cow<'_, Compiled> {
        self.scenes().map_or(Cow::Borrowed(&self.compiled), |scenes| Cow::Owned(compile(&scenes[i])))
    }

    /// Thruster allocation of instance `i`.
    pub fn allocation_of(&self, i: usize) -> &Allocation {
        self.own.as_ref().map_or(&self.allocation, |own| own.allocation(i))
    }
}

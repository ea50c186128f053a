//! PD with restoring compensation.

use super::plant::{Motion, Plant};
use super::rows::{ModelIndices, write};
use crate::control::{Controller, Pd, Widths};
use crate::description::Scene;
use crate::dynamics::aba::Scratch;
use crate::error::ControlError;
use crate::lane::{Isa, Kernel, Lane, Real};
use crate::lie::Vector6;

/// `F = -kp e - kd V - f_g`: a PD less the weight and buoyancy of vehicle, arm and payload at the measured attitude and
/// joint coordinates. Targets are level, so the attitude error alone tells the direction of gravity.
#[derive(Debug, Clone, PartialEq)]
pub struct PdRestoring {
    pd: Pd,
    reading: ModelIndices,
    plant: Plant,
}

impl PdRestoring {
    /// For a checked scene.
    pub fn new(pd: Pd, reading: ModelIndices, scene: &Scene) -> Self {
        Self { pd, reading, plant: Plant::new(scene) }
    }

    /// Its proportional and derivative part.
    pub fn pd(&self) -> &Pd {
        &self.pd
    }
}

impl Controller for PdRestoring {
    fn widths(&self) -> Widths {
        self.pd.widths()
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.widths().rows(observations, memory, actions)?;
        f64::dispatch(Isa::best().unwrap_or(Isa::Plain), &mut Rows { control: self, observations, actions });
        Ok(())
    }
}

struct Rows<'a> {
    control: &'a PdRestoring,
    observations: &'a [f32],
    actions: &'a mut [f32],
}

impl Kernel<f64> for Rows<'_> {
    #[inline(always)]
    fn run<L: Lane<Real = f64>>(&mut self) {
        let PdRestoring { pd, reading, plant } = self.control;
        let Widths { observation, action, .. } = pd.widths();
        let mut scratch = Scratch::new();
        let groups = self.observations.chunks(L::LANES * observation);
        for (rows, actions) in groups.zip(self.actions.chunks_mut(L::LANES * action)) {
            let seen = reading.read::<L>(rows);
            let mut arm = seen.arm;
            arm.qd = [L::zero(); crate::system::JOINTS];
            let at_rest = Motion { twist: Vector6::zero(), ..seen.motion };
            let force = plant.whole(&at_rest, &arm, &mut scratch).force;
            write(pd.actions(), pd.feedback(&seen.motion.error, &seen.motion.twist) - force, actions);
        }
    }
}

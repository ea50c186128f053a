//! PD station keeping with compensation of restoring forces.

use super::Pd;
use super::controller::{Controller, Widths};
use super::gains::GainMap;
use super::indices::ModelIndices;
use super::nominal_model::{NominalModel, VehicleMotion};
use super::rows::{read, write_actions};
use crate::description::Scene;
use crate::dynamics::aba::Scratch;
use crate::error::ControlError;
use crate::lane::{Isa, Kernel, Lane, Real};
use crate::lie::Vector6;
use crate::system::JOINTS;

/// `F = -kp e - kd V - f_g`: a PD minus the weight and buoyancy f_g of vehicle, arm and payload at the measured attitude
/// and joint coordinates. Targets are level, so the attitude error gives the direction of gravity.
#[derive(Debug, Clone, PartialEq)]
pub struct PdRestoring {
    pd: Pd,
    indices: ModelIndices,
    model: NominalModel,
}

impl PdRestoring {
    /// For a checked scene.
    pub fn new(pd: Pd, indices: ModelIndices, scene: &Scene) -> Self {
        Self { pd, indices, model: NominalModel::new(scene) }
    }
}

impl Controller for PdRestoring {
    fn widths(&self) -> Widths {
        self.pd.widths()
    }

    fn gains(&self) -> GainMap {
        self.pd.gains()
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
        let PdRestoring { pd, indices, model } = self.control;
        let Widths { observation, action, .. } = pd.widths();
        let mut scratch = Scratch::new();
        let count = self.observations.len() / observation;
        for first in (0..count).step_by(L::LANES) {
            let lanes = L::LANES.min(count - first);
            let rows = &self.observations[first * observation..][..lanes * observation];
            let actions = &mut self.actions[first * action..][..lanes * action];
            let measured = read::<L>(indices, rows);
            let mut arm = measured.arm;
            arm.qd = [L::zero(); JOINTS];
            let at_rest = VehicleMotion { twist: Vector6::zero(), ..measured.motion };
            let force = model.composite_body(&at_rest, &arm, &mut scratch).force;
            write_actions(pd.actions(), pd.feedback(&measured.motion.error, &measured.motion.twist) - force, actions);
        }
    }
}

//! PD station keeping with compensation of restoring forces.

use super::Pd;
use super::controller::{Controller, Widths};
use super::indices::ModelIndices;
use super::nominal_model::{ArmState, NominalModel, VehicleMotion};
use super::rows::{LaneLaw, Work, read, write_actions};
use crate::description::Scene;
use crate::error::ControlError;
use crate::lane::Lane;
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

impl LaneLaw for PdRestoring {
    #[inline(always)]
    fn control<L: Lane<Real = f64>>(
        &self,
        observations: &[f32],
        _: &mut [f64],
        actions: &mut [f32],
        work: &mut Work<L>,
    ) {
        let measured = read::<L>(&self.indices, observations);
        let arm = ArmState { qd: [L::zero(); JOINTS], ..measured.arm };
        let at_rest = VehicleMotion { twist: Vector6::zero(), ..measured.motion };
        let force = self.model.composite_body(&at_rest, &arm, &mut work.scratch).force;
        write_actions(&self.pd.actions, self.pd.gains.feedback(&measured.motion) - force, actions);
    }
}

impl Controller for PdRestoring {
    #[inline(always)]
    fn widths(&self) -> Widths {
        self.pd.widths()
    }

    fn act(&self, observations: &[f32], memory: &mut [f64], actions: &mut [f32]) -> Result<(), ControlError> {
        self.act_in_lanes(observations, memory, actions)
    }
}

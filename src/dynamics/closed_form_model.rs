//! Composed model of a scene: vehicle, arm and payload, loaded on each other. `[HC eqs. 28-34]`

use nalgebra::{DMatrix, DVector, Vector3};

use super::closed_form::ClosedForm;
use super::dense::{DenseBody, DensePose};
use super::dynamical_balance::Composite;
use crate::description::{Body, Parent, Scene, Vehicle};
use crate::error::DynamicsError;
use crate::system::{Flow, JOINTS, State};

/// Composed model of a scene, built once and evaluated at any state.
#[derive(Debug, Clone)]
pub struct ClosedFormModel {
    /// Vehicle, arm and payload.
    pub system: Composite,
    /// T_TCM, (6, thrusters): wrench on the vehicle per thrust. `[HC eq. 25]`
    pub thruster_configuration: DMatrix<f64>,
    /// True if the vehicle is fixed in the world. `[HC eq. 27]`
    pub fixed: bool,
    /// The vehicle, for the dense twins of its terms.
    pub vehicle: Vehicle,
    pub(super) density: f64,
    pub(super) gravity: Vector3<f64>,
    /// Body of `system` that carries the end effector, and the end effector in its frame.
    pub(super) end_effector: (usize, DensePose),
}

impl ClosedFormModel {
    /// Composes vehicle, arm and payload of a scene.
    ///
    /// # Errors
    /// [`DynamicsError::Joints`] for a scene with more joints than a [`State`] holds.
    pub fn new(scene: &Scene) -> Result<Self, DynamicsError> {
        let rigid = |body: &Body| Composite::rigid_body(DenseBody::new(body, &scene.water));
        let mut system = rigid(&scene.vehicle.body);
        let mut end_effector = (0, DensePose::identity());
        if let Some(arm) = &scene.arm {
            let mount = DensePose::from_frame(&arm.mount.frame);
            // Without a body the base is a mere frame.
            let frame = Body::default();
            let base = rigid(arm.base.as_ref().unwrap_or(&frame));
            system = match &arm.mount.joint {
                None => system.fixed_loading(0, mount, base),
                Some(joint) => system.joint_loading(0, mount, joint.clone(), base),
            };
            let body = |of| match of {
                Some(Parent::Link(k)) => 2 + k,
                Some(Parent::Base) => 1,
                Some(Parent::Vehicle) | None => 0,
            };
            for (i, link) in arm.links.iter().enumerate() {
                let (at, own) = (body(arm.parent(i)), rigid(link.body.as_ref().unwrap_or(&frame)));
                system = if link.moves() {
                    system.joint_loading(at, DensePose::identity(), link.joint.clone(), own)
                } else {
                    system.fixed_loading(at, DensePose::from_frame(&link.joint.frame), own)
                };
            }
            end_effector = (body(arm.tip()), DensePose::from_frame(&arm.end_effector));
        }
        if let Some(payload) = &scene.payload {
            let (at, frame) = end_effector;
            system = system.fixed_loading(at, frame * DensePose::from_frame(&payload.frame), rigid(&payload.body));
        }
        if system.joints() > JOINTS {
            return Err(DynamicsError::Joints { joints: system.joints(), max: JOINTS });
        }
        let thrusters = &scene.vehicle.thrusters;
        Ok(Self {
            system,
            thruster_configuration: DMatrix::from_fn(6, thrusters.len(), |i, k| thrusters[k].wrench()[i]),
            fixed: scene.vehicle.fixed,
            vehicle: scene.vehicle.clone(),
            density: scene.water.density,
            gravity: scene.water.gravity,
            end_effector,
        })
    }

    /// Closed form at `state` in a flow of the water or a steady current (world axes, m/s).
    pub fn at(&self, state: &State, flow: impl Into<Flow>) -> ClosedForm<'_> {
        let n = self.system.joints();
        let flow = flow.into();
        let water = state.rotation.tr_mul(&flow.velocity);
        let equations = self.system.at(&state.twist, &state.q[..n], &state.qd[..n], &water);
        let moving: Vec<usize> =
            equations.bodies.iter().enumerate().filter(|(k, body)| body.carrier == *k).map(|(k, _)| k).collect();
        ClosedForm {
            model: self,
            equations,
            moving,
            pose: DensePose { rotation: state.rotation, position: state.position },
            q: DVector::from_column_slice(&state.q[..n]),
            qd: DVector::from_column_slice(&state.qd[..n]),
            flow,
        }
    }
}

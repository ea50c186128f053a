//! Composed model of a scene: vehicle, arm and payload, loaded on each other. `[HC eqs. 28-34]`

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector, Vector3};

use super::closed_form::ClosedForm;
use super::dense::{DenseBody, DensePose};
use super::dynamical_balance::Composite;
use super::surroundings::Surroundings;
use crate::description::{Body, DEFAULT_END_EFFECTOR, EndEffectorFrame, Parent, Scene, Vehicle};
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
    /// The end effector in use.
    pub(super) end_effector: BodyFrame,
    /// End effectors by name.
    end_effectors: BTreeMap<String, BodyFrame>,
    /// Spheres and shapes, where the scene has any.
    pub(super) surroundings: Surroundings,
}

/// A body of [`ClosedFormModel::system`], and a frame on it, relative to the body's frame.
pub type BodyFrame = (usize, DensePose);

impl ClosedFormModel {
    /// Composes vehicle, arm and payload of a scene.
    ///
    /// # Errors
    /// [`DynamicsError::Joints`] for a scene with more joints than a [`State`] holds.
    pub fn new(scene: &Scene) -> Result<Self, DynamicsError> {
        let rigid = |body: &Body| Composite::rigid_body(DenseBody::new(body, &scene.water));
        let mut system = rigid(&scene.vehicle.body);
        let mut end_effector = (0, DensePose::identity());
        let mut grip = end_effector;
        let mut end_effectors = BTreeMap::from([(DEFAULT_END_EFFECTOR.to_owned(), end_effector)]);
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
            let on = |of: &EndEffectorFrame| (body(arm.carrier(of)), DensePose::from_frame(&of.frame()));
            let names = scene.end_effector_names().into_iter();
            end_effectors =
                names.filter_map(|name| arm.end_effector_named(&name).map(on).map(|of| (name, of))).collect();
            end_effector = on(&arm.end_effector);
            grip = scene.payload.as_ref().map_or(end_effector, |payload| on(arm.payload_end_effector(payload)));
        }
        if let Some(payload) = &scene.payload {
            let (at, frame) = grip;
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
            end_effectors,
            surroundings: Surroundings::new(scene)?,
        })
    }

    /// End effector of this name; by default the end effector in use.
    ///
    /// # Errors
    /// [`DynamicsError::EndEffector`] for an unknown name.
    pub fn end_effector(&self, name: Option<&str>) -> Result<BodyFrame, DynamicsError> {
        let Some(name) = name else { return Ok(self.end_effector) };
        let known = || self.end_effectors.keys().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
        let unknown = || DynamicsError::EndEffector { name: name.to_owned(), known: known() };
        self.end_effectors.get(name).copied().ok_or_else(unknown)
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
            fixtures: self.surroundings.fixtures_at(&state.q[n..], &state.qd[n..], &flow),
        }
    }
}

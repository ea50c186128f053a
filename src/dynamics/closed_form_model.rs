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
    /// The arm with its payload as a separate free-base system, base frame first; none if links start at the vehicle. `[HC eq. 28]`
    pub arm: Option<Composite>,
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
        let rigid = |body| Composite::rigid_body(DenseBody::new(body, &scene.water));
        let payload =
            scene.payload.as_ref().map(|payload| (DensePose::from_frame(&payload.frame), rigid(&payload.body)));
        let vehicle = rigid(&scene.vehicle.body);
        let (system, arm, end_effector) = match &scene.arm {
            None => {
                let system = match payload {
                    None => vehicle,
                    Some((frame, payload)) => vehicle.fixed_loading(0, frame, payload),
                };
                (system, None, (0, DensePose::identity()))
            }
            Some(description) => {
                let end_effector = DensePose::from_frame(&description.end_effector);
                let mount = DensePose::from_frame(&description.mount.frame);
                let on_vehicle = |arm| match &description.mount.joint {
                    None => vehicle.clone().fixed_loading(0, mount, arm),
                    Some(joint) => vehicle.clone().joint_loading(0, mount, joint.clone(), arm),
                };
                // Without a body the base is a mere frame.
                let base = DenseBody::new(description.base.as_ref().unwrap_or(&Body::default()), &scene.water);
                // First the arm, then both on each other, unless links start at the vehicle.
                let parents: Vec<_> = (0..description.links.len()).map(|i| description.parent(i)).collect();
                let alone = !parents.iter().chain([&description.tip()]).any(|of| *of == Some(Parent::Vehicle));
                let (mut system, base) = (Composite::rigid_body(base), usize::from(!alone));
                if !alone {
                    system = on_vehicle(system);
                }
                let body = |of| match of {
                    Some(Parent::Link(k)) => base + 1 + k,
                    Some(Parent::Base) => base,
                    Some(Parent::Vehicle) | None => 0,
                };
                for (link, parent) in description.links.iter().zip(parents) {
                    system = system.joint_loading(
                        body(parent),
                        DensePose::identity(),
                        link.joint.clone(),
                        rigid(&link.body),
                    );
                }
                let tip = body(description.tip());
                if let Some((frame, payload)) = payload {
                    system = system.fixed_loading(tip, end_effector * frame, payload);
                }
                if alone {
                    (on_vehicle(system.clone()), Some(system), (1 + tip, end_effector))
                } else {
                    (system, None, (tip, end_effector))
                }
            }
        };
        if system.joints() > JOINTS {
            return Err(DynamicsError::Joints { joints: system.joints(), max: JOINTS });
        }
        let thrusters = &scene.vehicle.thrusters;
        Ok(Self {
            system,
            arm,
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

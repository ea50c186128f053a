//! Scenes of single instances.

use crate::control::Allocation;
use crate::description::Scene;
use crate::error::SimulatorError;
use crate::limits::interrupt;
use crate::system::{Compiled, compile, structural_difference};

/// Scenes of all instances, of equal structure.
#[derive(Debug, Clone)]
pub struct OwnScenes {
    scenes: Vec<Scene>,
    /// Their thruster allocations.
    allocations: Vec<Allocation>,
    /// True where thrusters or fins differ.
    pub own_actuators: bool,
}

impl OwnScenes {
    /// Scenes of the instances; `first` is the first of them, compiled.
    ///
    /// # Errors
    /// [`SimulatorError::Structure`] names the first scene that has a term which the first scene lacks, or lacks one;
    /// [`SimulatorError::Control`] as [`Allocation::new`].
    pub fn new(scenes: Vec<Scene>, first: &Compiled) -> Result<Self, SimulatorError> {
        let Some(model) = scenes.first() else { return Err(SimulatorError::NoInstances) };
        let keys = model.coordinate_keys();
        let mut allocations = Vec::with_capacity(scenes.len());
        for (instance, scene) in scenes.iter().enumerate() {
            if interrupt::requested() {
                return Err(SimulatorError::Interrupted);
            }
            let difference = difference_outside_kernels(model, scene)
                .or_else(|| structural_difference(first, &compile(scene), &keys));
            if let Some(place) = difference {
                return Err(SimulatorError::Structure { instance, scene: scene.name.clone(), place });
            }
            allocations.push(Allocation::new(&scene.vehicle)?);
        }
        let actuators = |scene: &Scene| {
            let vehicle = &scene.vehicle;
            (vehicle.thrusters.clone(), vehicle.thruster_lag, vehicle.voltage, vehicle.fins.clone())
        };
        let own_actuators = scenes.iter().any(|scene| actuators(scene) != actuators(model));
        Ok(Self { scenes, allocations, own_actuators })
    }

    /// Scene of each instance.
    pub fn scenes(&self) -> &[Scene] {
        &self.scenes
    }

    /// Thruster allocation of instance `i`.
    pub fn allocation(&self, i: usize) -> &Allocation {
        &self.allocations[i]
    }
}

/// A difference in structure that compiled scenes do not show.
fn difference_outside_kernels(one: &Scene, other: &Scene) -> Option<String> {
    let counts = |scene: &Scene| [scene.coordinates().count(), scene.vehicle.thrusters.len(), scene.vehicle.fins.len()];
    let names = ["arm: joints", "vehicle.thrusters", "vehicle.fins"]
        .into_iter()
        .zip(counts(one).into_iter().zip(counts(other)));
    let count = names.filter(|(_, (a, b))| a != b).map(|(name, (a, b))| format!("{name}: {b}, not {a}")).next();
    count.or_else(|| {
        let servos = |scene: &Scene| scene.coordinates().map(|joint| joint.servo.is_some()).collect::<Vec<_>>();
        let differs = one.vehicle.servo.is_some() != other.vehicle.servo.is_some();
        let place = if differs { Some("vehicle.servo") } else { None };
        let place = place.or((servos(one) != servos(other)).then_some("arm: a joint's servo"));
        place.map(|place| format!("{place}, in whether it is there"))
    })
}

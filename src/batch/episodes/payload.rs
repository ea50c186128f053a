//! Payload events of an instance at the start of a control period.

use crate::batch::stepping::chunk::PhysicsChunk;
use crate::dynamics::ClosedFormModel;
use crate::lane::Real;
use crate::task::disturbance::{Column, DisturbanceKernel, PayloadEvent};
use crate::task::{EpisodeKey, Task, grasp_impulse};

/// Applies the payload event of instance `k` of `part` before control period `step` of the episode `key`, if there is one.
pub(super) fn apply_payload_event<T: Real>(
    task: &Task,
    disturbance: &DisturbanceKernel<T>,
    memory: &mut Column<'_, T>,
    (key, step): (EpisodeKey, u32),
    part: &mut PhysicsChunk<'_, T>,
    k: usize,
) {
    let Some(event) = disturbance.payload_event(memory, step) else { return };
    let mut factors = part.table.factors(part.rows, k);
    match event {
        PayloadEvent::Grasp(mass) => {
            let own = task.scene_draws().map(|draws| draws.draw(key).0);
            let scene = own.as_ref().unwrap_or(task.scene());
            // A scene that composes with its own masses does so with scaled ones.
            if let Ok(model) = ClosedFormModel::new(&scene.varied(factors.of_bodies())) {
                let mut state = part.table.state(part.rows, k);
                grasp_impulse(&model, &mut state, mass);
                part.set_velocities(k, &state);
            }
            factors.payload += mass;
            disturbance.hold(memory, mass);
        }
        PayloadEvent::Release(mass) => {
            factors.payload = (factors.payload - mass).max(0.0);
            disturbance.hold(memory, 0.0);
        }
    }
    part.set_factors(k, &factors);
}

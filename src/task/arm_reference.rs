//! Arms that follow references under their joints' servos: observation blocks and errors that such tasks share.

use std::f64::consts::PI;

use super::bounds::{POSITION_BOUND, bounded_length};
use super::definition::{ControlInstant, TaskDefinition};
use super::model::TaskModel;
use super::observation::{Layout, ObservationWriter, joint_entries};
use super::reference::JointReferenceRows;
use crate::lane::Lane;
use crate::lie::rotation_angle;
use crate::system::JOINTS;

/// Appends the blocks of the joints' references.
pub(super) fn push_blocks(model: &TaskModel, layout: &mut Layout) {
    let [coordinates, rates] = joint_entries(&model.joints);
    let next = "reference at the next control instant, relative to home";
    layout.push("joint_reference", "rad or m", next, &coordinates);
    let rate = "rate of the reference at the next control instant";
    layout.push("joint_reference_rate", "rad/s or m/s", rate, &rates);
}

/// Writes the entries of these blocks.
#[inline(always)]
pub(super) fn observe<L: Lane, K: TaskDefinition>(
    at: &ControlInstant<'_, L, K>,
    rows: &JointReferenceRows,
    writer: &mut ObservationWriter<'_, L::Real>,
) {
    for i in 0..rows.joints {
        writer.put(at.memory.get::<L>(rows.next + 2 * i) - L::splat(at.kernel.home[i]));
    }
    for i in 0..rows.joints {
        writer.put(at.memory.get::<L>(rows.next + 2 * i + 1));
    }
}

/// Distance (m) and angle (rad) between the end effector and its pose for a vehicle on target and joints on their
/// references.
#[inline(always)]
pub(super) fn end_effector_error<L: Lane, K: TaskDefinition>(
    at: &ControlInstant<'_, L, K>,
    rows: &JointReferenceRows,
) -> [L; 2] {
    let ControlInstant { kernel, memory, state, error } = at;
    let mut reference = [L::zero(); JOINTS];
    for i in 0..rows.joints {
        reference[i] = memory.get(rows.now + 2 * i);
    }
    // Both end effectors in the target's frame.
    let (actual, wanted) = (kernel.end_effector.at(&state.q), kernel.end_effector.at(&reference));
    let distance = error.turn.apply(actual.position + error.position) - wanted.position;
    let turned = wanted.rotation.transposed().times(&error.turn.times(&actual.rotation));
    [bounded_length(distance, POSITION_BOUND), rotation_angle(&turned).min(L::c(PI))]
}

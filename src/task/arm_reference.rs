//! Arms that follow references under their joints' servos: the parts that such tasks share.

use std::f64::consts::PI;

use super::bounds::{POSITION_BOUND, bounded_length};
use super::definition::{ControlInstant, EpisodeStart, TaskDefinition, TaskKernel};
use super::episode::{RowAllocator, TaskRows};
use super::model::TaskModel;
use super::observation::{ObservationLayout, ObservationWriter, joint_entries};
use super::reference::{JointReference, JointReferenceRows};
use crate::lane::{Lane, Rows};
use crate::lie::rotation_angle;
use crate::system::JOINTS;

/// Appends the blocks of the joints' references.
pub(super) fn push_blocks(model: &TaskModel, layout: &mut ObservationLayout) {
    let [coordinates, rates] = joint_entries(&model.joints);
    let next = "reference at the next control instant, relative to home";
    layout.push("joint_reference", "rad or m", next, &coordinates);
    let rate = "rate of the reference at the next control instant";
    layout.push("joint_reference_rate", "rad/s or m/s", rate, &rates);
}

/// Rows of the joints' references.
pub(super) fn rows(model: &TaskModel, rows: &mut RowAllocator) -> TaskRows {
    let joints = JointReferenceRows::new(model.joints.len(), |count| rows.take(count));
    TaskRows { joints: Some(joints), ..TaskRows::default() }
}

/// Draws the joints' references, at most `amplitude` (rad) about home: see [`JointReference::draw`].
pub(super) fn sample<K: TaskDefinition>(
    kernel: &TaskKernel<f64, K>,
    start: &EpisodeStart<'_>,
    amplitude: f64,
    memory: &mut Rows<'_, f64>,
) {
    let Some(rows) = kernel.rows.task.joints else { return };
    let (range, period) = ([amplitude * start.arm[0], start.arm[1]], start.options.control_period());
    for (i, joint) in start.model.joints.iter().enumerate() {
        let reference = JointReference::draw(joint, start.state.q[i], range, period, &start.draw, i as u32);
        memory.set_all(rows.reference + JointReference::<f64>::LEN * i, &reference.to_array());
    }
}

/// Sets the points of the first control instants.
#[inline(always)]
pub(super) fn begin<L: Lane, K: TaskDefinition>(kernel: &TaskKernel<L::Real, K>, memory: &mut Rows<'_, L::Real>) {
    if let Some(rows) = &kernel.rows.task.joints {
        rows.begin(memory, L::splat(kernel.frequency));
    }
}

/// Moves the references to the next control instant.
#[inline(always)]
pub(super) fn advance<L: Lane, K: TaskDefinition>(kernel: &TaskKernel<L::Real, K>, memory: &mut Rows<'_, L::Real>) {
    if let Some(rows) = &kernel.rows.task.joints {
        rows.advance(memory, L::splat(kernel.frequency));
    }
}

/// Writes the entries of these blocks.
#[inline(always)]
pub(super) fn observe<L: Lane, K: TaskDefinition>(
    at: &ControlInstant<'_, L, K>,
    writer: &mut ObservationWriter<'_, L::Real>,
) {
    let Some(rows) = &at.kernel.rows.task.joints else { return };
    for i in 0..rows.joints {
        writer.put(at.memory.get::<L>(rows.next + 2 * i) - L::splat(at.kernel.home[i]));
    }
    for i in 0..rows.joints {
        writer.put(at.memory.get::<L>(rows.next + 2 * i + 1));
    }
}

/// Distance (m) and angle (rad) between the end effector and its pose for a vehicle on target and joints on their
/// references; `bounded` without references.
#[inline(always)]
pub(super) fn end_effector_error<L: Lane, K: TaskDefinition>(at: &ControlInstant<'_, L, K>, bounded: [L; 2]) -> [L; 2] {
    let ControlInstant { kernel, memory, state, error } = at;
    let (Some(rows), false) = (&kernel.rows.task.joints, K::DRIVES_JOINTS) else { return bounded };
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

//! Station keeping: the vehicle holds a pose while its arm follows references and a current pushes.

use serde::{Deserialize, Serialize};

use super::arm_reference;
use super::bounds::{POSITION_BOUND, shorter};
use super::definition::{EpisodeStart, TaskDefinition, TaskKernel};
use super::disturbance::MEASURED;
use super::episode::{EpisodeRows, RowAllocator, TaskRows};
use super::model::TaskModel;
use super::observation::{Layout, ObservationWriter};
use super::options::{Options, check_non_negative};
use super::pose::PoseError;
use super::reference::JointReferenceRows;
use super::stage_state::StageState;
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows};
use crate::lie::Vector3;
use crate::system::JOINTS;

/// Station keeping.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StationKeep {
    /// Maximum amplitude of the arm's reference about home, rad (a quarter of it in metres for prismatic joints).
    pub arm_amplitude: f64,
}

impl Default for StationKeep {
    fn default() -> Self {
        Self { arm_amplitude: 0.4 }
    }
}

impl TaskDefinition for StationKeep {
    const NAME: &'static str = "station-keep";
    const ENVIRONMENT: &'static str = "UVMS-StationKeep";

    type Kernel<T: Real> = JointReferenceRows;

    fn check(&self, _start_distance: f64) -> Result<(), TaskError> {
        check_non_negative(&[("arm_amplitude", self.arm_amplitude)])
    }

    fn layout(_options: &Options<Self>, model: &TaskModel, layout: &mut Layout) {
        arm_reference::push_blocks(model, layout);
    }

    fn rows(model: &TaskModel, rows: &mut RowAllocator) -> TaskRows {
        let joints = JointReferenceRows::new(model.joints.len(), |count| rows.take(count));
        TaskRows { joints: Some(joints), ..TaskRows::default() }
    }

    fn kernel<T: Real>(_options: &Options<Self>, _model: &TaskModel, rows: &EpisodeRows) -> JointReferenceRows {
        rows.task.joints.expect("rows of the joint references")
    }

    fn sample(kernel: &TaskKernel<f64, Self>, start: &EpisodeStart<'_, Self>, memory: &mut Rows<'_, f64>) {
        let [amplitude, speed] = start.arm;
        let range = [start.options.task.arm_amplitude * amplitude, speed];
        let (joints, q, period) = (&start.model.joints, &start.state.q, start.options.control_period());
        kernel.task.draw(memory, joints, q, range, period, &start.draw);
    }

    #[inline(always)]
    fn begin<T: Real, L: Lane<Real = T>>(kernel: &TaskKernel<T, Self>, memory: &mut Rows<'_, T>) {
        kernel.task.begin(memory, L::splat(kernel.frequency));
    }

    #[inline(always)]
    fn advance<T: Real, L: Lane<Real = T>>(kernel: &TaskKernel<T, Self>, memory: &mut Rows<'_, T>) {
        kernel.task.advance(memory, L::splat(kernel.frequency));
    }

    #[inline(always)]
    fn joint_targets<T: Real, L: Lane<Real = T>>(
        kernel: &TaskKernel<T, Self>,
        memory: &Rows<'_, T>,
        joints: &mut [[L; 4]; JOINTS],
    ) {
        kernel.task.targets(memory, L::splat(kernel.frequency), joints);
    }

    #[inline(always)]
    fn observe<T: Real, L: Lane<Real = T>>(
        kernel: &TaskKernel<T, Self>,
        memory: &Rows<'_, T>,
        _state: &StageState<L>,
        _error: &PoseError<L>,
        _measured: &[L; MEASURED],
        writer: &mut ObservationWriter<'_, T>,
    ) {
        arm_reference::observe::<T, L, Self>(kernel, &kernel.task, memory, writer);
    }

    #[inline(always)]
    fn in_bounds<T: Real, L: Lane<Real = T>>(
        kernel: &TaskKernel<T, Self>,
        memory: &Rows<'_, T>,
        state: &StageState<L>,
        _error: &PoseError<L>,
    ) -> L::Mask {
        let target: [L; 3] = memory.get_all(kernel.rows.target + 9);
        shorter(state.pose.position - Vector3(target), POSITION_BOUND)
    }

    #[inline(always)]
    fn end_effector_error<T: Real, L: Lane<Real = T>>(
        kernel: &TaskKernel<T, Self>,
        memory: &Rows<'_, T>,
        state: &StageState<L>,
        error: &PoseError<L>,
        _bounded: [L; 2],
    ) -> [L; 2] {
        arm_reference::end_effector_error(kernel, &kernel.task, memory, state, error)
    }
}

//! Station keeping: the vehicle holds a pose while its arm follows references and a current pushes.

use super::arm_reference;
use super::bounds::{POSITION_BOUND, shorter};
use super::definition::{ControlInstant, EpisodeStart, TaskDefinition, TaskKernel};
use super::disturbance::MEASURED;
use super::episode::{EpisodeRows, RowAllocator, TaskRows};
use super::model::TaskModel;
use super::observation::{Layout, ObservationWriter};
use super::options::{TaskOptions, check_non_negative};
use super::reference::JointReferenceRows;
use super::settings::settings;
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows};
use crate::lie::Vector3;
use crate::system::JOINTS;

settings! {
    /// Station keeping.
    pub struct StationKeep {
        /// Maximum amplitude of the arm's reference about home, rad (a quarter of it in metres for prismatic joints).
        arm_amplitude: f64 = 0.4;
    }
}

impl TaskDefinition for StationKeep {
    const NAME: &'static str = "station-keep";
    const ENVIRONMENT: &'static str = "UVMS-StationKeep";

    const MEASURED_INPUTS: usize = 0;

    type Kernel<T: Real> = JointReferenceRows;

    fn check(&self, _start_distance: f64) -> Result<(), TaskError> {
        check_non_negative(&[("arm_amplitude", self.arm_amplitude)])
    }

    fn layout(&self, _options: &TaskOptions, model: &TaskModel, layout: &mut Layout) {
        arm_reference::push_blocks(model, layout);
    }

    fn rows(&self, model: &TaskModel, rows: &mut RowAllocator) -> TaskRows {
        let joints = JointReferenceRows::new(model.joints.len(), |count| rows.take(count));
        TaskRows { joints: Some(joints), ..TaskRows::default() }
    }

    fn kernel<T: Real>(&self, _options: &TaskOptions, _model: &TaskModel, rows: &EpisodeRows) -> JointReferenceRows {
        rows.task.joints.expect("rows of the joint references")
    }

    fn sample(&self, kernel: &TaskKernel<f64, Self>, start: &EpisodeStart<'_>, memory: &mut Rows<'_, f64>) {
        let [amplitude, speed] = start.arm;
        let range = [self.arm_amplitude * amplitude, speed];
        let (joints, q, period) = (&start.model.joints, &start.state.q, start.options.control_period());
        kernel.task.draw(memory, joints, q, range, period, &start.draw);
    }

    #[inline(always)]
    fn begin<L: Lane>(kernel: &TaskKernel<L::Real, Self>, memory: &mut Rows<'_, L::Real>) {
        kernel.task.begin(memory, L::splat(kernel.frequency));
    }

    #[inline(always)]
    fn advance<L: Lane>(kernel: &TaskKernel<L::Real, Self>, memory: &mut Rows<'_, L::Real>) {
        kernel.task.advance(memory, L::splat(kernel.frequency));
    }

    #[inline(always)]
    fn joint_targets<L: Lane>(
        kernel: &TaskKernel<L::Real, Self>,
        memory: &Rows<'_, L::Real>,
        joints: &mut [[L; 4]; JOINTS],
    ) {
        kernel.task.targets(memory, L::splat(kernel.frequency), joints);
    }

    #[inline(always)]
    fn observe<L: Lane>(
        at: &ControlInstant<'_, L, Self>,
        _measured: &[L; MEASURED],
        writer: &mut ObservationWriter<'_, L::Real>,
    ) {
        arm_reference::observe(at, &at.kernel.task, writer);
    }

    #[inline(always)]
    fn in_bounds<L: Lane>(at: &ControlInstant<'_, L, Self>) -> L::Mask {
        let target: [L; 3] = at.memory.get_all(at.kernel.rows.target + 9);
        shorter(at.state.pose.position - Vector3(target), POSITION_BOUND)
    }

    #[inline(always)]
    fn end_effector_error<L: Lane>(at: &ControlInstant<'_, L, Self>, _bounded: [L; 2]) -> [L; 2] {
        arm_reference::end_effector_error(at, &at.kernel.task)
    }
}

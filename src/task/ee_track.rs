//! End-effector tracking: the end effector follows a path; the action drives vehicle and joints.

use std::f64::consts::PI;

use super::bounds::{POSITION_BOUND, shorter};
use super::definition::{BaseController, ControlInstant, EpisodeStart, Frame, TaskDefinition, TaskKernel};
use super::disturbance::MEASURED;
use super::episode::{EpisodeRows, PathRows, RowAllocator, TaskRows, pose, set_pose};
use super::model::TaskModel;
use super::observation::{ERROR_SCALE, ObservationLayout, ObservationWriter, PREVIEW, TWIST, joint_bounds, six};
use super::options::{TaskOptions, check_range};
use super::path::{PATH, PathKind, draw_path, path_advance, path_point};
use super::pose::PoseError;
use super::reward::RewardWeights;
use super::settings::settings;
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows};
use crate::lie::Vector3;

settings! {
    /// End-effector tracking.
    pub struct EETrack {
        /// Kind of path.
        reference: PathKind = PathKind::Mixed;
        /// Amplitude or radius, m; 50 to 100 % of it are drawn.
        reference_size: f64 = 0.4;
        /// Maximum speed, m/s; 50 to 100 % of it are drawn.
        reference_speed: f64 = 0.2;
        /// Maximum amplitude of rotation about the vertical, rad; less than a third of it out of the horizontal.
        reference_rotation: f64 = 0.4;
        /// Points of the path ahead.
        preview: Preview = Preview::default();
    }
}

settings! {
    /// Observed points of the path ahead.
    pub struct Preview {
        /// Number of points.
        points: u32 = 3;
        /// Time between them, and from now to the first, s.
        spacing: f64 = 0.2;
    }
}

/// Numbers of the kernel.
#[derive(Debug, Clone, PartialEq)]
pub struct EETrackKernel<T> {
    rows: PathRows,
    /// Preview points, and the control periods between them.
    preview: (usize, T),
    /// Maximum distance of each joint coordinate from home.
    travel: Vec<T>,
}

impl TaskDefinition for EETrack {
    const NAME: &'static str = "ee-track";
    const ENVIRONMENT: &'static str = "UVMS-EETrack";
    const FRAME: Frame = Frame::EndEffector;
    const DRIVES_JOINTS: bool = true;
    const OBSERVES_UP: bool = true;
    const BASE: BaseController = BaseController::ResolvedMotion;
    /// Errors against the points ahead include the measurement error of the present pose error.
    const MEASURED_INPUTS: usize = 6;

    type Kernel<T: Real> = EETrackKernel<T>;

    /// Divergence costs as much as 90 steps at a metre from the reference, so ending the episode early seldom pays.
    fn defaults() -> TaskOptions {
        let options = TaskOptions::default();
        // Random actions throw the arm at its stops, which longer steps do not resolve.
        let reward = RewardWeights { diverged: 100.0, ..options.reward };
        TaskOptions { dt: 0.005, substeps: 10, reward, ..options }
    }

    fn check(&self, _start_distance: f64) -> Result<(), TaskError> {
        for (name, value, maximum, allowed) in [
            ("reference_size", self.reference_size, 5.0, "in [0, 5] m"),
            ("reference_speed", self.reference_speed, 2.0, "in [0, 2] m/s"),
            ("reference_rotation", self.reference_rotation, 0.6, "in [0, 0.6] rad"),
            ("preview.points", f64::from(self.preview.points), PREVIEW as f64, "0 to 8"),
            ("preview.spacing", self.preview.spacing, 10.0, "in [0, 10] s"),
        ] {
            check_range(name, value, (0.0..=maximum).contains(&value), allowed)?;
        }
        Ok(())
    }

    fn layout(&self, _options: &TaskOptions, _model: &TaskModel, layout: &mut ObservationLayout) {
        let Preview { points, spacing } = self.preview;
        let (speed, ahead) = (self.reference_speed, f64::from(points) * spacing);
        layout.push("reference_twist", "m/s and rad/s", "velocities of the reference, end-effector axes", &six(TWIST));
        let point = six([(ERROR_SCALE, POSITION_BOUND + 1.01 * speed * ahead), (ERROR_SCALE, PI)]);
        let description = "both errors against each point of the reference ahead";
        layout.push("preview", "m and rad", description, &point.repeat(points as usize));
    }

    fn rows(&self, _model: &TaskModel, rows: &mut RowAllocator) -> TaskRows {
        let points = self.preview.points as usize;
        TaskRows { path: Some(PathRows::new(rows, points)), ..TaskRows::default() }
    }

    fn kernel<T: Real>(&self, options: &TaskOptions, model: &TaskModel, rows: &EpisodeRows) -> EETrackKernel<T> {
        let (Preview { points, spacing }, number) = (self.preview.clone(), T::from_f64);
        EETrackKernel {
            rows: rows.task.path.expect("rows of the path"),
            preview: (points as usize, number(spacing / options.control_period())),
            travel: joint_bounds(&model.layout).into_iter().map(number).collect(),
        }
    }

    fn sample(&self, kernel: &TaskKernel<f64, Self>, start: &EpisodeStart<'_>, memory: &mut Rows<'_, f64>) {
        let EpisodeStart { options, model, .. } = start;
        let pose = model.end_effector_pose(&start.target, &model.home);
        let path = draw_path(self, &pose, start.up(), model.drives.tilt, options.control_period(), &start.draw);
        memory.set_all::<f64, PATH>(kernel.task.rows.path, &path);
    }

    #[inline(always)]
    fn begin<L: Lane>(kernel: &TaskKernel<L::Real, Self>, memory: &mut Rows<'_, L::Real>) {
        set_target::<L>(kernel, memory);
    }

    #[inline(always)]
    fn advance<L: Lane>(kernel: &TaskKernel<L::Real, Self>, memory: &mut Rows<'_, L::Real>) {
        path_advance::<L>(memory, kernel.task.rows.path);
        set_target::<L>(kernel, memory);
    }

    #[inline(always)]
    fn observe<L: Lane>(
        at: &ControlInstant<'_, L, Self>,
        measured: &[L; MEASURED],
        writer: &mut ObservationWriter<'_, L::Real>,
    ) {
        let ControlInstant { kernel, memory, state, error } = at;
        let EETrackKernel { rows, preview, .. } = &kernel.task;
        let frame = kernel.frame(state);
        for part in [rows.motion, rows.motion + 3] {
            writer.put_vector(frame.rotation.apply_transposed(Vector3(memory.get_all(part))));
        }
        // Preview errors carry the measurement error of the present ones.
        let shift = Vector3([measured[0], measured[1], measured[2]]) - error.position;
        let turn = Vector3([measured[3], measured[4], measured[5]]) - error.rotation;
        let has_sensors = kernel.sensors().is_some();
        for k in 0..preview.0 {
            let ahead = PoseError::of(&frame, &pose(memory, rows.ahead + 12 * k));
            writer.put_vector(if has_sensors { ahead.position + shift } else { ahead.position });
            writer.put_vector(if has_sensors { ahead.rotation + turn } else { ahead.rotation });
        }
    }

    #[inline(always)]
    fn in_bounds<L: Lane>(at: &ControlInstant<'_, L, Self>) -> L::Mask {
        let ControlInstant { kernel, state, error, .. } = at;
        let mut mask = shorter(error.position, POSITION_BOUND);
        // Driven joints have no servo to bring them back.
        for i in 0..kernel.rows.joints {
            let distance = (state.q[i] - L::splat(kernel.home[i])).abs();
            mask = L::and(mask, distance.lt(L::splat(kernel.task.travel[i])));
        }
        mask
    }
}

/// Sets the target and its velocities to the path's current point, and the poses ahead.
#[inline(always)]
fn set_target<L: Lane>(kernel: &TaskKernel<L::Real, EETrack>, memory: &mut Rows<'_, L::Real>) {
    let EETrackKernel { rows, preview: (points, spacing), .. } = &kernel.task;
    let frequency = L::splat(kernel.frequency);
    let point = path_point::<L>(memory, rows.path, L::zero(), frequency);
    kernel.rows.set_target(memory, &point.pose);
    memory.set_all(rows.motion, &point.velocity.0);
    memory.set_all(rows.motion + 3, &point.turning.0);
    for k in 0..*points {
        let ahead = L::c((k + 1) as f64) * L::splat(*spacing);
        let point = path_point::<L>(memory, rows.path, ahead, frequency);
        set_pose(memory, rows.ahead + 12 * k, &point.pose);
    }
}

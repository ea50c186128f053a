//! The kernel of any task for one instance in f64, behind one interface.

use std::fmt::Debug;

use super::definition::{ControlInstant, EpisodeStart, Frame, TaskDefinition, TaskKernel};
use super::disturbance::DisturbanceKernel;
use super::episode::EpisodeRows;
use super::gradient::TaskGradient;
use super::kernel::Command;
use super::metrics::Outcome;
use super::model::TaskModel;
use super::options::Options;
use super::pose::{Pose, StageState};
use super::random::{EpisodeKey, Purpose, Stream};
use crate::control::ACTIONS;
use crate::lane::Rows;
use crate::system::State;

/// A task's kernel for one instance.
pub(super) trait ScalarKernel: Debug + Send + Sync {
    fn rows(&self) -> &EpisodeRows;
    fn disturbance(&self) -> Option<&DisturbanceKernel<f64>>;
    /// Pose of the task's frame.
    fn frame(&self, model: &TaskModel, state: &State) -> Pose;
    /// Drawn pose of the vehicle at an episode's start.
    fn start_pose(&self, model: &TaskModel, target: &Pose, draw: &Stream) -> Pose;
    /// Draws the references of an episode, whose target is set; `arm` are factors on the arm's amplitude and speed.
    fn sample(
        &self,
        model: &TaskModel,
        key: EpisodeKey,
        start: (&Pose, &State),
        arm: [f64; 2],
        memory: &mut Rows<'_, f64>,
    );
    fn begin(&self, memory: &mut Rows<'_, f64>);
    fn act(&self, memory: &mut Rows<'_, f64>, action: &mut [f64; ACTIONS]) -> Command<f64>;
    /// Records the forcing and the first measurement of an episode's start.
    fn measure_start(&self, memory: Rows<'_, f64>, state: &StageState<f64>);
    /// Advances to the next control instant and evaluates it.
    fn advance(&self, memory: Rows<'_, f64>, state: &StageState<f64>, share: f64) -> Outcome;
    fn observe(&self, memory: Rows<'_, f64>, state: &StageState<f64>, row: &mut [f32]);
    fn gradient(&self) -> &dyn TaskGradient;
}

/// Options and kernel of a task.
#[derive(Debug)]
pub(super) struct Scalar<K: TaskDefinition> {
    pub options: Options<K>,
    pub kernel: TaskKernel<f64, K>,
}

impl<K: TaskDefinition> ScalarKernel for Scalar<K> {
    fn rows(&self) -> &EpisodeRows {
        self.kernel.rows()
    }

    fn disturbance(&self) -> Option<&DisturbanceKernel<f64>> {
        self.kernel.disturbance()
    }

    fn frame(&self, model: &TaskModel, state: &State) -> Pose {
        match K::FRAME {
            Frame::Vehicle => Pose::of_vehicle(state),
            Frame::EndEffector => model.end_effector_of(state),
        }
    }

    fn start_pose(&self, model: &TaskModel, target: &Pose, draw: &Stream) -> Pose {
        K::start_pose(&self.options, model, target, draw)
    }

    fn sample(
        &self,
        model: &TaskModel,
        key: EpisodeKey,
        (target, state): (&Pose, &State),
        arm: [f64; 2],
        memory: &mut Rows<'_, f64>,
    ) {
        let (options, draw) = (&self.options, Stream::new(key, Purpose::REFERENCE));
        K::sample(&self.kernel, &EpisodeStart { options, model, target: *target, state, arm, draw }, memory);
    }

    fn begin(&self, memory: &mut Rows<'_, f64>) {
        self.kernel.begin::<f64>(memory);
    }

    fn act(&self, memory: &mut Rows<'_, f64>, action: &mut [f64; ACTIONS]) -> Command<f64> {
        let mut command = Command::none();
        self.kernel.act(memory, action, None, &mut command);
        command
    }

    fn measure_start(&self, mut memory: Rows<'_, f64>, state: &StageState<f64>) {
        let Some(disturbance) = self.kernel.disturbance() else { return };
        let forcing = disturbance.forcing(&memory, &state.pose, &state.twist);
        disturbance.record(&mut memory, self.kernel.rows().current, &forcing);
        ControlInstant::new(&self.kernel, memory, state).measure(true);
    }

    fn advance(&self, mut memory: Rows<'_, f64>, state: &StageState<f64>, share: f64) -> Outcome {
        self.kernel.advance::<f64>(&mut memory);
        Outcome::new(&ControlInstant::new(&self.kernel, memory, state).evaluate(share), K::METRICS.len())
    }

    fn observe(&self, memory: Rows<'_, f64>, state: &StageState<f64>, row: &mut [f32]) {
        ControlInstant::new(&self.kernel, memory, state).observe(row);
    }

    fn gradient(&self) -> &dyn TaskGradient {
        &self.kernel
    }
}

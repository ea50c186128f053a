//! The kernel of any task for one instance in f64, behind one interface.

use std::fmt::Debug;

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3, Vector6};

use super::definition::{ControlInstant, EpisodeStart, Frame, TaskDefinition, TaskKernel};
use super::disturbance::{Column, DisturbanceKernel};
use super::episode::{Episode, EpisodeRows};
use super::gradient::TaskGradient;
use super::kernel::Command;
use super::metrics::Outcome;
use super::model::TaskModel;
use super::options::StartOverride;
use super::pose::{Pose, StageState};
use super::random::{EpisodeKey, Purpose, Stream};
use super::scene_task::Task;
use crate::control::ACTIONS;
use crate::lane::Rows;
use crate::system::State;

/// A task's kernel for one instance.
pub(super) trait ScalarKernel: Debug + Send + Sync {
    fn rows(&self) -> &EpisodeRows;
    fn disturbance(&self) -> Option<&DisturbanceKernel<f64>>;
    /// Pose of the task's frame.
    fn frame(&self, model: &TaskModel, state: &State) -> Pose;
    /// Start of an episode with given parts; the others are drawn.
    fn start(&self, task: &Task, key: EpisodeKey, given: &StartOverride) -> (Episode, State);
    fn act(&self, memory: &mut Rows<'_, f64>, action: &mut [f64; ACTIONS]) -> Command<f64>;
    /// Advances to the next control instant and evaluates it.
    fn advance(&self, memory: Rows<'_, f64>, state: &StageState<f64>, share: f64) -> Outcome;
    fn observe(&self, memory: Rows<'_, f64>, state: &StageState<f64>, row: &mut [f32]);
    fn gradient(&self) -> &dyn TaskGradient;
}

/// A task with its kernel.
#[derive(Debug)]
pub(super) struct Scalar<K: TaskDefinition> {
    pub task: K,
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

    fn start(&self, task: &Task, key: EpisodeKey, given: &StartOverride) -> (Episode, State) {
        let (options, model, kernel) = (task.options(), task.model(), &self.kernel);
        let [_, _, up] = model.level;
        let disturbance = given.disturbance.as_ref().unwrap_or(task.disturbance());
        let arm = disturbance.arm.unwrap_or_default();

        let draw = Stream::new(key, Purpose::TARGET);
        let target = Pose {
            position: given
                .target_position
                .map_or_else(|| draw.unit_vector(0) * (options.target_distance * draw.uniform(1)), Vector3::from),
            rotation: given.target_attitude.map_or_else(
                || Pose::turn(up * draw.uniform_in(2, -options.target_heading, options.target_heading)).rotation,
                rotation,
            ),
        };

        let draw = Stream::new(key, Purpose::CURRENT);
        let current = given.current.map(Vector3::from).unwrap_or_else(|| {
            let (own, steady) = (model.scene.water.current, disturbance.current.as_ref());
            steady.map_or(own, |steady| own + steady.draw(&draw, &model.context))
        });

        let drawn = self.task.start_pose(options, model, &target, &Stream::new(key, Purpose::START));
        let position = given.position.map_or(drawn.position, Vector3::from);
        let attitude = given.attitude.map_or(drawn.rotation, rotation);
        let twist = given.twist.map_or_else(Vector6::zeros, Vector6::from);
        let mut state = State { position, rotation: attitude, twist, q: model.home, ..State::default() };
        state.q.iter_mut().zip(given.q.iter().flatten()).for_each(|(q, x)| *q = *x);
        state.qd.iter_mut().zip(given.qd.iter().flatten()).for_each(|(qd, x)| *qd = *x);

        let mut episode = Episode::blank(key, kernel.rows);
        episode.set_target(&target);
        let mut memory = episode.memory();
        memory.set_all::<f64, 3>(kernel.rows.current, &current.into());
        let (arm, draw) = ([arm.amplitude, arm.speed], Stream::new(key, Purpose::REFERENCE));
        let start = EpisodeStart { options, model, target, state: &state, arm, draw };
        self.task.sample(kernel, &start, &mut memory);
        if let Some(kernel) = kernel.disturbance() {
            kernel.begin(&mut Column::of_one(&mut episode.numbers), key, &current, disturbance);
        }
        kernel.begin::<f64>(&mut episode.memory());
        if let Some(disturbance) = kernel.disturbance() {
            let (mut memory, state) = (episode.memory(), StageState::from(&state));
            let forcing = disturbance.forcing(&memory, &state.pose, &state.twist);
            disturbance.record(&mut memory, kernel.rows.current, &forcing);
            ControlInstant::new(kernel, memory, &state).measure(true);
        }
        if let Some(sensors) = kernel.sensors() {
            sensors.fill(&mut Column::of_one(&mut episode.numbers));
        }
        (episode, state)
    }

    fn act(&self, memory: &mut Rows<'_, f64>, action: &mut [f64; ACTIONS]) -> Command<f64> {
        let mut command = Command::none();
        self.kernel.actions().act(memory, action, None, &mut command);
        command
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

/// Rotation matrix of a quaternion [w, x, y, z] of any length but zero.
fn rotation([w, x, y, z]: [f64; 4]) -> Matrix3<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix().into_inner()
}

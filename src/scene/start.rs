//! How episodes start.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3, Vector6};

use super::episode::Episode;
use super::options::StartOverride;
use super::pose::Pose;
use super::random::{EpisodeKey, Purpose, Stream};
use super::reference::JointReference;
use super::task::Task;
use crate::error::{ControlError, TaskError};
use crate::system::State;

/// Greatest angle of a drawn current against the horizontal, rad.
const CURRENT_ELEVATION: f64 = 0.25;

impl Task {
    /// The start of an episode and the state it starts from, all drawn.
    pub fn begin(&self, key: EpisodeKey) -> (Episode, State) {
        self.start(key, &StartOverride::default())
    }

    /// As [`Self::begin`], with some of it given. What is not given is drawn as if nothing were.
    ///
    /// # Errors
    /// `TaskError` for a joint array of the wrong length, a number that is not finite, a quaternion of length zero, and
    /// a start that would count as diverged.
    pub fn begin_with(&self, key: EpisodeKey, given: &StartOverride) -> Result<(Episode, State), TaskError> {
        let n = self.joints.len();
        for (what, values) in [("q", &given.q), ("qd", &given.qd)] {
            if let Some(values) = values.as_ref().filter(|v| v.len() != n) {
                return Err(ControlError::Shape { what, got: values.len(), expected: n }.into());
            }
        }
        let fields: [(&'static str, Option<&[f64]>); 8] = [
            ("position", given.position.as_ref().map(|x| &x[..])),
            ("attitude", given.attitude.as_ref().map(|x| &x[..])),
            ("twist", given.twist.as_ref().map(|x| &x[..])),
            ("q", given.q.as_deref()),
            ("qd", given.qd.as_deref()),
            ("target_position", given.target_position.as_ref().map(|x| &x[..])),
            ("target_attitude", given.target_attitude.as_ref().map(|x| &x[..])),
            ("current", given.current.as_ref().map(|x| &x[..])),
        ];
        for (name, values) in fields {
            if let Some(value) = values.unwrap_or_default().iter().find(|x| !x.is_finite()) {
                return Err(TaskError::Start { name, value: *value, allowed: "finite".into() });
            }
        }
        for ((q, home), bound) in given.q.iter().flatten().zip(self.home()).zip(self.joint_bounds()) {
            if (q - home).abs() > bound {
                let allowed = format!("within {bound} of home ({home}), beyond which it is not observed");
                return Err(TaskError::Start { name: "q", value: *q, allowed });
            }
        }
        for (name, quaternion) in [("attitude", given.attitude), ("target_attitude", given.target_attitude)] {
            let norm = quaternion.map_or(1.0, |q| q.iter().map(|x| x * x).sum::<f64>().sqrt());
            if !(1e-6..1e6).contains(&norm) {
                return Err(TaskError::Start { name, value: norm, allowed: "a quaternion of length near 1".into() });
            }
        }
        let (episode, state) = self.start(key, given);
        match self.violation(&episode.target(), &state) {
            Some((name, value, bound)) => {
                Err(TaskError::Start { name, value, allowed: format!("below {bound}, where a run has diverged") })
            }
            None => Ok((episode, state)),
        }
    }

    /// Greatest observed distance of each joint coordinate from home.
    fn joint_bounds(&self) -> impl Iterator<Item = f64> {
        let block = self.layout().block("joint_position");
        block.into_iter().flat_map(|b| b.bound.iter().zip(&b.scale).map(|(bound, scale)| bound * scale))
    }

    fn start(&self, key: EpisodeKey, given: &StartOverride) -> (Episode, State) {
        let options = &self.options;
        let turn = |vector: Vector3<f64>| Rotation3::from_scaled_axis(vector).into_inner();
        let [forward, left, up] = self.level;

        let draw = Stream::new(key, Purpose::Target);
        let target = Pose {
            position: given
                .target_position
                .map_or_else(|| draw.unit_vector(0) * (options.target_distance * draw.uniform(1)), Vector3::from),
            rotation: given
                .target_attitude
                .map_or_else(|| turn(up * draw.uniform_in(2, -options.target_turn, options.target_turn)), rotation),
        };

        let draw = Stream::new(key, Purpose::Current);
        let current = given.current.map(Vector3::from).unwrap_or_else(|| {
            let azimuth = draw.uniform_in(0, 0.0, TAU);
            let elevation = draw.uniform_in(1, -CURRENT_ELEVATION, CURRENT_ELEVATION);
            let level = forward * azimuth.cos() + left * azimuth.sin();
            self.scene_current
                + (level * elevation.cos() + up * elevation.sin()) * draw.uniform_in(2, 0.0, options.max_current)
        });

        let draw = Stream::new(key, Purpose::Start);
        let position = given.position.map_or_else(
            || target.position + draw.unit_vector(0) * (options.start_distance * draw.uniform(1)),
            Vector3::from,
        );
        let attitude = given.attitude.map_or_else(
            || target.rotation * turn(draw.unit_vector(2) * (options.start_angle * draw.uniform(3))),
            rotation,
        );
        let twist = given.twist.map_or_else(Vector6::zeros, Vector6::from);
        let mut state = State { position, rotation: attitude, twist, q: *self.home(), ..State::default() };
        state.q.iter_mut().zip(given.q.iter().flatten()).for_each(|(q, x)| *q = *x);
        state.qd.iter_mut().zip(given.qd.iter().flatten()).for_each(|(qd, x)| *qd = *x);

        let draw = Stream::new(key, Purpose::Reference);
        let mut episode = Episode::blank(key, *self.kernel().rows());
        episode.set_target(&target);
        let (rows, period) = (episode.rows, options.control_period());
        let mut memory = episode.memory();
        memory.set_all::<f64, 3>(rows.current, &current.into());
        for (i, joint) in self.joints.iter().enumerate() {
            let reference = JointReference::draw(joint, state.q[i], options.arm_amplitude, period, &draw, i as u32);
            memory.set_all(rows.reference + JointReference::<f64>::LEN * i, &reference.to_array());
        }
        self.kernel().aim::<f64>(&mut memory);
        (episode, state)
    }
}

/// Rotation matrix of a quaternion [w, x, y, z] of any length but zero.
fn rotation([w, x, y, z]: [f64; 4]) -> Matrix3<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix().into_inner()
}

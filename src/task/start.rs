//! Starts of episodes.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3, Vector6};

use super::bounds::violation;
use super::disturbance::{Column, Disturbance, DisturbanceKernel};
use super::episode::Episode;
use super::observation::joint_bounds;
use super::options::StartOverride;
use super::pose::{Pose, StageState};
use super::random::{EpisodeKey, Purpose, Stream};
use super::scene_task::Task;
use crate::error::{ControlError, TaskError};
use crate::system::{Factors, State};

impl Task {
    /// Drawn start of an episode, and its start state.
    pub fn begin(&self, key: EpisodeKey) -> (Episode, State) {
        self.start(key, &StartOverride::default())
    }

    /// Start of an episode with given parts; the others are drawn as without them.
    ///
    /// # Errors
    /// `TaskError` for a joint array of the wrong length, a number that is not finite, a quaternion of length zero, and
    /// a start that would count as diverged.
    pub fn begin_with(&self, key: EpisodeKey, given: &StartOverride) -> Result<(Episode, State), TaskError> {
        let n = self.joint_count();
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
        for ((q, home), bound) in given.q.iter().flatten().zip(&self.model().home).zip(joint_bounds(self.layout())) {
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
        if let Some(disturbance) = &given.disturbance {
            disturbance.check(&self.model().context)?;
            self.disturbance().check_room(disturbance, self.options().control_period())?;
        }
        let (episode, state) = self.start(key, given);
        let frame = self.kernel().frame(self.model(), &state);
        match violation(&frame, &episode.target(), &state, n) {
            Some((name, value, bound)) => {
                Err(TaskError::Start { name, value, allowed: format!("below {bound}, where a run has diverged") })
            }
            None => Ok((episode, state)),
        }
    }

    fn start(&self, key: EpisodeKey, given: &StartOverride) -> (Episode, State) {
        let options = self.options();
        let model = self.model();
        let [_, _, up] = model.level;
        let disturbance = given.disturbance.as_ref().unwrap_or(self.disturbance());
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

        let drawn = self.kernel().start_pose(model, &target, &Stream::new(key, Purpose::START));
        let position = given.position.map_or(drawn.position, Vector3::from);
        let attitude = given.attitude.map_or(drawn.rotation, rotation);
        let twist = given.twist.map_or_else(Vector6::zeros, Vector6::from);
        let mut state = State { position, rotation: attitude, twist, q: model.home, ..State::default() };
        state.q.iter_mut().zip(given.q.iter().flatten()).for_each(|(q, x)| *q = *x);
        state.qd.iter_mut().zip(given.qd.iter().flatten()).for_each(|(qd, x)| *qd = *x);

        let kernel = self.kernel();
        let mut episode = Episode::blank(key, *kernel.rows());
        episode.set_target(&target);
        let current_row = episode.rows.current;
        let mut memory = episode.memory();
        memory.set_all::<f64, 3>(current_row, &current.into());
        kernel.sample(model, key, (&target, &state), [arm.amplitude, arm.speed], &mut memory);
        if let Some(kernel) = kernel.disturbance() {
            kernel.begin(&mut Column::of_one(&mut episode.numbers), key, &current, disturbance);
        }
        kernel.begin(&mut episode.memory());
        kernel.measure_start(episode.memory(), &StageState::from(&state));
        if let Some(sensors) = kernel.disturbance().and_then(DisturbanceKernel::sensors) {
            sensors.fill(&mut Column::of_one(&mut episode.numbers));
        }
        (episode, state)
    }

    /// Factors on the scene's parameters in an episode with this start; `None` where they are always 1.
    pub fn factors(&self, key: EpisodeKey, given: &StartOverride) -> Option<Factors<f64>> {
        let own = self.disturbance();
        let disturbance = match &given.disturbance {
            // Parameters of the option `randomize` stay.
            Some(given) if self.options().randomize.is_some() => {
                &Disturbance { parameters: own.parameters.clone(), ..given.clone() }
            }
            Some(given) => given,
            None => own,
        };
        own.varies().then(|| disturbance.factors(key))
    }
}

/// Rotation matrix of a quaternion [w, x, y, z] of any length but zero.
fn rotation([w, x, y, z]: [f64; 4]) -> Matrix3<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix().into_inner()
}

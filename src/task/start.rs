//! Starts of episodes.

use super::bounds::violation;
use super::disturbance::Disturbance;
use super::episode::Episode;
use super::observation::joint_bounds;
use super::options::StartOverride;
use super::random::EpisodeKey;
use super::scene_task::Task;
use crate::error::{ControlError, TaskError};
use crate::system::{Factors, State};

impl Task {
    /// Drawn start of an episode, and its start state.
    pub fn begin(&self, key: EpisodeKey) -> (Episode, State) {
        self.kernel().start(self, key, &StartOverride::default())
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
        let (episode, state) = self.kernel().start(self, key, given);
        let frame = self.kernel().frame(self.model(), &state);
        match violation(&frame, &episode.target(), &state, n) {
            Some((name, value, bound)) => {
                Err(TaskError::Start { name, value, allowed: format!("below {bound}, where a run has diverged") })
            }
            None => Ok((episode, state)),
        }
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

//! Tasks: sampling, references, observation, reward.
//!
//! Everything is per instance and depends on the task, the seed and the number of the episode alone. What happens at every
//! control instant is written in lanes; episodes are drawn one by one, in f64.

mod authority;
mod controllers;
pub mod disturbance;
mod disturbed;
mod episode;
mod kernel;
mod layout;
mod metrics;
mod observation;
mod options;
mod path;
mod pose;
mod random;
mod reference;
mod stance;
mod start;
mod task;
mod truth;

#[cfg(test)]
mod tests;

pub use controllers::ControllerKind;
pub use episode::{Episode, EpisodeRows};
pub use kernel::{Command, TaskKernel};
pub use layout::{Block, Layout};
pub use metrics::{INFO, Judgement, Metrics, Outcome, RewardTerms};
pub use options::{Goal, PREVIEW, Preview, RewardWeights, StartOverride, TaskOptions, Tolerance};
pub use path::{PATH, PathKind, PathPoint, path_advance, path_places, path_point};
pub use pose::{Pose, PoseError};
pub use random::{EpisodeKey, Purpose, Stream};
pub use reference::{JointReference, METRES_PER_RADIAN, ReferencePoint, hermite};
pub use stance::Stance;
pub use task::{DEFAULT_HORIZON, Task};
pub use truth::{truth, truth_layout};

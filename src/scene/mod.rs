//! Tasks: sampling, references, observation, reward.
//!
//! Everything is per instance, in f64, and depends on the task, the seed and the number of the episode alone.

mod episode;
mod layout;
mod metrics;
mod observation;
mod options;
mod policies;
mod pose;
mod random;
mod reference;
mod start;
mod station_keep;

#[cfg(test)]
mod tests;

pub use episode::{ACTIONS, Episode};
pub use layout::{Block, Layout};
pub use metrics::{Metrics, Outcome, RewardTerms};
pub use options::{RewardWeights, StartOverride, StationKeepOptions};
pub use pose::{Pose, PoseError, rotation_vector};
pub use random::{EpisodeKey, Purpose, Stream};
pub use reference::{JointReference, METRES_PER_RADIAN, ReferencePoint, hermite};
pub use station_keep::{Command, DEFAULT_HORIZON, StationKeep};

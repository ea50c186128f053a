//! Tasks: sampling, references, observation, reward.
//!
//! Everything is per instance and depends on the task, the seed and the number of the episode alone. What happens at every
//! control instant is written in lanes; episodes are drawn one by one, in f64.

pub mod disturbance;
mod episode;
mod keeper;
mod layout;
mod metrics;
mod observation;
mod options;
mod policies;
mod pose;
mod random;
mod reference;
mod stance;
mod start;
mod station_keep;

#[cfg(test)]
mod tests;

pub use episode::{Episode, EpisodeRows};
pub use keeper::{Command, Keeper};
pub use layout::{Block, Layout};
pub use metrics::{INFO, Judgement, Metrics, Outcome, RewardTerms};
pub use options::{RewardWeights, StartOverride, StationKeepOptions};
pub use pose::{Pose, PoseError};
pub use random::{EpisodeKey, Purpose, Stream};
pub use reference::{JointReference, METRES_PER_RADIAN, ReferencePoint, hermite};
pub use stance::Stance;
pub use station_keep::{DEFAULT_HORIZON, StationKeep};

//! Tasks: sampling of episodes, references, observations, metrics and rewards.
//!
//! A task is a type that implements [`TaskDefinition`] in one file (`station_keep`, `ee_track`, `dock`, `button`, `valve`) and is listed in `registry`.
//! All results are per instance and depend on the task, the seed and the number of the episode only. The steps at a control
//! instant are written in lanes ([`TaskKernel`]), compiled once per task and precision; episodes are drawn one by one in f64.

mod arm_reference;
mod bounds;
mod button;
mod contact_force;
mod controllers;
mod cradle;
mod definition;
pub mod disturbance;
mod dock;
mod drives;
mod ee_track;
mod episode;
mod gradient;
mod kernel;
mod manipulation;
mod metrics;
mod model;
pub mod observation;
mod observe;
mod options;
pub mod path;
mod pose;
mod privileged;
pub mod random;
mod reference;
mod registry;
mod reward;
mod scalar;
mod scene_draws;
mod scene_task;
pub(crate) mod settings;
mod start;
mod station_keep;
mod tool_path;
mod valve;
mod workplace;

pub use button::Button;
pub use controllers::ControllerKind;
pub use definition::{BaseController, ControlInstant, Frame, TaskDefinition, TaskKernel};
pub use dock::{Dock, DockArm, DockKind};
pub use ee_track::{EETrack, Preview};
pub use episode::{Episode, EpisodeRows};
pub use gradient::{Acted, Evaluated, GradientWidths, TaskGradient};
pub use kernel::{ActionKernel, Command};
pub use metrics::{Evaluation, INFO, METRICS, Metrics, OWN_METRICS, Outcome};
pub use observation::{Block, ObservationLayout, PREVIEW};
pub use options::{StartOverride, TaskOptions, Tolerance};
pub use path::{PATH, PathKind, PathPoint, path_advance, path_places, path_point};
pub use pose::{Pose, PoseError, StageState};
pub use privileged::{privileged, privileged_layout};
pub use random::{EpisodeKey, Purpose, Stream};
pub use reference::{JointReference, PRISMATIC_PER_RADIAN, ReferencePoint, hermite};
pub(crate) use registry::dispatch_task;
pub use registry::{TASKS, TaskKind};
pub use reward::RewardWeights;
pub use scene_draws::SceneDraws;
pub use scene_task::{DEFAULT_HORIZON, Task};
pub use station_keep::StationKeep;
pub use valve::{Valve, ValveContract};

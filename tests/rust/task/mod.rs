//! Tasks: sampling, observation, reward, disturbances.

mod disturbance;
mod observation;
mod path;
mod pose;
mod random;
mod reference;
mod station_keep;

//! Tasks: sampling, observation, reward, disturbances.

mod disturbance;
mod dock;
mod manipulation;
mod observation;
mod path;
mod pose;
mod random;
mod reference;
mod station_keep;

//! Sensors of a vehicle: readings of its motion with noise, biases, rate, delay, drop-outs and failures.
//!
//! A sensor is a type that implements [`Sensor`] in one file and has a line in the list of `suite`. Draws depend only on
//! the seed, the episode, the sensor and the number of its sample.

mod acoustic;
mod batch;
mod depth;
mod dvl;
mod heading;
mod imu;
mod motion;
mod sensor;
mod suite;

pub use acoustic::Acoustic;
pub use batch::{Readings, SensorReadings, Sensors};
pub use depth::Depth;
pub use dvl::{BEAMS, Dvl};
pub use heading::{Heading, heading};
pub use imu::Imu;
pub use motion::{Motion, Mount, exponential, rotation_vector};
pub use sensor::{BIASES, Draws, Field, Sensor, Timing, VALUES, tick};
pub use suite::Suite;

//! What the water does to a body, besides added mass, which is inertia.

mod appendages;
mod central;
mod damping;
mod restoring;
mod slope;
mod thruster;

pub use appendages::{FINS, Fin, Surfaces, Tether};
pub use central::{Central, Turn};
pub use damping::{Coefficients, Drag, Placement};
pub use restoring::Restoring;
pub use thruster::{Branch, Fading, Propulsion, THRUSTERS, Thruster, Thrusts, thrust_wrench};

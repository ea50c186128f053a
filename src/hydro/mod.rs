//! What the water does to a body, besides added mass, which is inertia.

mod appendages;
mod damping;
mod principal;
mod restoring;
mod slope;
mod thruster;

pub use appendages::{FINS, Fin, Surfaces, Tether};
pub use damping::{Coefficients, Drag, Placement};
pub use principal::{Place, Principal};
pub use restoring::Restoring;
pub use thruster::{Branch, Fading, Propulsion, THRUSTERS, Thruster, Thrusts, thrust_wrench};

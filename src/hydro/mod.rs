//! What the water does to a body, besides added mass, which is inertia.

mod damping;
mod principal;
mod restoring;
mod slope;

pub use damping::{Coefficients, Drag, Placement};
pub use principal::Principal;
pub use restoring::Restoring;

//! Spatial inertia in 21 numbers, and how it moves between frames.

mod bend;
mod inertia;
mod point;

pub use bend::{Bend, Screw, constant_screw_z, screw_x, screw_z};
pub use inertia::SpatialInertia;
pub use point::{Place, PointMass};

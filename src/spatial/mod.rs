//! Spatial inertia in 21 numbers, and its transformation between frames.

mod blocks;
mod inertia;
mod point;
mod screw;

pub use blocks::EarlierBlocks;
pub use inertia::SpatialInertia;
pub use point::{BodyPoint, PointMass};
pub use screw::{LinkTwist, Screw, constant_screw_z, screw_x, screw_z};

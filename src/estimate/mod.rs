//! Estimates of mass, buoyancy, added mass and damping of bodies of boxes, cylinders, capsules and ellipsoids.
//!
//! Added mass: potential flow for ellipsoids `[Lamb 1932]`, strip theory and published tables for the others `[DNV-H103]`,
//! `[F21 ch. 6]`. Quadratic damping: projected areas and published coefficients `[Hoerner]`, `[White]`, `[DNV-C205]`.
//! Linear damping: equal to the quadratic one at a stated speed. Shapes do not shield each other.

mod body;
pub mod lamb;
mod outline;
pub mod solid;
pub mod tables;
mod text;

pub use body::Estimate;
pub use outline::{Outline, Shape};
pub use solid::{Axis, Ends, Round};

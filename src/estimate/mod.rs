//! A body's numbers from its shape: boxes, cylinders, capsules and ellipsoids in water.
//!
//! Added mass: potential flow for ellipsoids `[Lamb 1932]`, strip theory and published tables for the others `[DNV-H103]`,
//! `[F21 ch. 6]`. Quadratic drag: projected areas and published coefficients `[Hoerner]`, `[White]`, `[DNV-C205]`. Linear
//! drag: equal to the quadratic one at a stated speed. Shapes do not shield each other.

mod body;
pub mod lamb;
mod outline;
pub mod solid;
pub mod tables;
mod text;

pub use body::Estimate;
pub use outline::{Axis, Ends, Outline, Round, Shape};

//! Arms from URDF files: the serial chain between two links, with its hydrodynamics estimated from the links' geometry.
//!
//! Taken over: joint frames, axes, limits, effort, speed, damping and friction, and every link's inertia. Links that fixed
//! joints carry, and those that hang off the chain, are merged into the link that carries them. What URDF does not know is
//! estimated, and each number says so in the scene's provenance: added mass, drag and volume from boxes, cylinders,
//! capsules and spheres ([`crate::estimate`]), servos and end stops from the inertia that a joint carries.

mod chain;
mod file;
mod import;
mod links;

pub use import::{Import, Imported};

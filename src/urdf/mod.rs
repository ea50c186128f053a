//! Import of arms from URDF files: the serial chain between two links, with hydrodynamics estimated from the links' geometry.
//!
//! Imported: joint frames, axes, limits, effort, speed, damping and friction, `armature` (of `<dynamics>`, as in MJCF) as
//! rotor inertia, and the inertia of every link. Links behind fixed joints, and links outside the chain, are merged into the link that carries them. Quantities unknown to URDF are estimated and
//! marked in the scene's provenance: added mass, damping and volume from boxes, cylinders, capsules and spheres
//! ([`crate::estimate`]), servos and end stops from the inertia that a joint carries.

mod chain;
mod element;
mod file;
mod import;
mod links;

pub use import::{Import, Imported};

//! Robots from files: readers of each format into plain data ([`Robot`]), and scenes from that ([`Assembly`]).
//!
//! Read are joint frames, axes, limits, effort, speed, damping, friction, springs and rotor inertia (`armature`), the inertia of
//! every link, hydrodynamics and thrusters that simulators' plugins state. All joints that move are joints of one tree; links
//! behind fixed joints are merged into the part that carries them. Quantities unknown to the file are estimated and marked in the
//! scene's provenance: added mass, damping and volume from the links' outlines ([`crate::estimate`]), servos and end stops from the
//! inertia that they move.

mod arm;
mod assemble;
mod body;
mod check;
mod content;
mod element;
mod ends;
mod hull;
mod lift;
mod merge;
mod motion;
mod outline;
mod parts;
mod plugins;
mod read;
mod sdf;
mod servo;
mod thrusters;
mod tree;
mod urdf;
mod water;

pub use assemble::{Assembly, Imported};
pub use parts::{
    InWater, Inertial, Mesh, MeshInertia, Mimic, Robot, RobotFin, RobotJoint, RobotJointKind, RobotLink, RobotThruster,
};
pub use thrusters::ThrusterSource;

//! Underwater vehicle-manipulator systems on SE(3).
//!
//! Layers; each imports only those before it in this list, and any of them its errors from `error`:
//!
//! ```text
//! lane          numbers, one or many at a time
//! limits        interrupts of long computations, memory
//! lie           SO(3), SE(3), dexp
//! spatial       twists, wrenches, inertia
//! hydro         drag, restoring
//! description   scenes as plain data
//! estimate      a body's numbers from its shape
//! urdf          arms from URDF files
//! system        compile(description), state
//! dynamics      equations of motion: dynamical balance in closed form, ABA, RNEA, CRBA, linearization
//! integrate     Munthe-Kaas methods, a linearly implicit one, baseline methods
//! render        pictures
//! optimize      box-constrained differential dynamic programming
//! control       thruster allocation; policies: PD, PID, feedback on the nominal model, resolved motion, neural networks
//! task          tasks: sampling, observation, reward
//! batch         blocks of lanes, threads, closed loops
//! planning      trajectory optimisation on the steps of a simulator
//! python        the Python module: a crate on top of this one
//! ```
//!
#![doc = include_str!("NOTATION.md")]
#![deny(unsafe_code)]

pub mod batch;
pub mod control;
pub mod description;
pub mod dynamics;
pub mod error;
pub mod estimate;
pub mod hydro;
pub mod integrate;
pub mod lane;
pub mod lie;
pub mod limits;
pub mod optimize;
pub mod planning;
pub mod render;
pub mod spatial;
pub mod system;
pub mod task;
pub mod urdf;

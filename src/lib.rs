//! Underwater vehicle-manipulator systems on SE(3).
//!
//! Layers; each imports only those before it in this list, and any of them its errors from `error`:
//!
//! ```text
//! lane          numbers, one or many at a time
//! lie           SO(3), SE(3), dexp
//! spatial       twists, wrenches, inertia
//! hydro         drag, restoring
//! description   scenes as plain data
//! estimate      a body's numbers from its shape
//! urdf          arms from URDF files
//! system        compile(description), state
//! balance       the principle of dynamical balance: closed form, articulated bodies, ledger
//! integrate     Munthe-Kaas methods, a linearly implicit one, rivals
//! render        pictures
//! control       thruster allocation; policies: PD, PID, feedback on the nominal model, resolved motion, neural networks
//! scene         tasks: sampling, observation, reward
//! batch         blocks of lanes, threads, closed loops
//! python        the Python module
//! ```
//!
#![doc = include_str!("NOTATION.md")]

pub mod balance;
pub mod batch;
pub mod control;
pub mod description;
pub mod error;
pub mod estimate;
pub mod hydro;
pub mod integrate;
pub mod lane;
pub mod lie;
#[cfg(feature = "python")]
mod python;
pub mod render;
pub mod scene;
pub mod spatial;
pub mod system;
pub mod urdf;

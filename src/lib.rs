//! Underwater vehicle-manipulator systems on SE(3): simulation of batches of instances, with exact derivatives.
//!
//! # Interface
//!
//! - [`description::Scene`]: vehicle, arm and water as plain data, from a shipped scene or a TOML file.
//! - [`batch::Simulator`]: instances of a scene. [`batch::Inputs`] are the loads of a step, [`system::State`] is the state of
//!   an instance. Derivatives of steps: `step_jacobians`, `step_jvp`, `step_vjp`.
//! - [`dynamics::ClosedFormModel`]: mass matrix, bias, damping, restoring forces, energy and momentum at a state.
//!
//! All else serves the Python package `uvms_gym` and may change at any time. The crate is not published by itself.
//!
//! # Quick start
//!
//! `examples/step.rs`; further examples compare integrators and differentiate a step.
//!
//! ```
#![doc = include_str!("../examples/step.rs")]
//! ```
//!
//! # Layers
//!
//! Each imports only those before it in this list, and errors from `error`:
//!
//! ```text
//! lane          numbers, one or many at a time
//! limits        interrupts of long computations, memory
//! lie           SO(3), SE(3), dexp
//! spatial       twists, wrenches, inertia
//! hydro         damping, restoring, thrusters
//! contact       contact of spheres with shapes: distances, law of the force
//! keys          keys of scene files: short forms, checks, axes; trees of values
//! terms         further forces on the vehicle, one file each: fins, tether, damping by forward speed
//! description   scenes as plain data: TOML, checks, warnings
//! estimate      coefficients of a body from its shape
//! robot         robots from files of several formats
//! system        compile(description), state
//! dynamics      equations of motion: dynamical balance in closed form, ABA, RNEA, linearization
//! integrate     Munthe-Kaas methods, a linearly implicit one, baseline methods
//! render        software rasteriser
//! optimize      box-constrained differential dynamic programming
//! control       thruster allocation, actuation, controllers, observers, neural networks
//! task          tasks: episodes, disturbances, observation, reward, metrics
//! sensors       IMU, DVL, depth, heading and acoustic fixes from the motion
//! navigation    error-state Kalman filter on SE(3)
//! batch         blocks of lanes, threads, closed loops
//! planning      trajectory optimisation on the steps of a simulator
//! python        the Python module: a crate above this one
//! ```
//!
#![doc = include_str!("NOTATION.md")]
#![deny(unsafe_code)]
#![warn(missing_docs)]

pub mod batch;
pub mod contact;
pub mod control;
pub mod description;
pub mod dynamics;
pub mod error;
pub mod estimate;
pub mod hydro;
pub mod integrate;
pub mod keys;
pub mod lane;
pub mod lie;
pub mod limits;
pub mod navigation;
pub mod optimize;
pub mod planning;
pub mod render;
pub mod robot;
pub mod sensors;
pub mod spatial;
pub mod system;
pub mod task;
pub mod terms;

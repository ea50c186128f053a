//! Pictures of a scene: a z-buffer rasteriser with four samples per pixel, fed by the kinematics of the physics.
//!
//! A picture depends on the scene, the settings and the [`Shot`] alone: the same bytes whatever was drawn before. What
//! is not finite, or far away beyond all measure, is left out of it.

mod arm;
mod backdrop;
pub mod camera;
pub mod hull;
pub mod marks;
pub mod mesh;
pub mod paint;
pub mod raster;
mod renderer;
mod shadow;
pub use renderer::{Renderer, Settings, Shot};

/// Vectors of the picture: single precision, and relative to what the camera looks at.
pub type Vector = nalgebra::Vector3<f32>;

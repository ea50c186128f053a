//! Pictures of a scene: a z-buffer rasteriser with four samples per pixel, fed by the kinematics of the physics.
//!
//! A picture depends on the scene, the settings and the [`Shot`] alone: the same bytes whatever was drawn before. What
//! is not finite, or far away beyond all measure, is left out of it.

mod arm;
mod backdrop;
mod camera;
mod hull;
mod marks;
mod mesh;
mod paint;
mod raster;
mod renderer;
mod shadow;
#[cfg(test)]
mod tests;

pub use renderer::{Renderer, Settings, Shot};

/// Vectors of the picture: single precision, and relative to what the camera looks at.
type Vector = nalgebra::Vector3<f32>;

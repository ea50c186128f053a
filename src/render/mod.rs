//! Pictures of a scene by a z-buffer rasteriser with four samples per pixel, from the kinematics of the simulator.
//!
//! A picture depends only on scene, settings and [`RenderState`]: the same bytes, independent of earlier pictures. Objects at
//! positions that are not finite or too far away are omitted.

mod arm;
mod backdrop;
mod bodies;
pub mod camera;
pub mod dock;
pub mod files;
pub mod hull;
pub mod marks;
pub mod mesh;
pub mod paint;
pub mod raster;
mod renderer;
mod shadow;
mod spheres;
pub mod surroundings;
mod view;
pub use bodies::bodies;
pub use files::{Facet, Facets};
pub use renderer::{RenderState, Renderer, Settings};
pub use spheres::{BodySphere, Spheres};

/// Vector in single precision, relative to the focus of the camera.
pub type Vector = nalgebra::Vector3<f32>;

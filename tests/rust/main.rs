//! Integration tests of the library, in one binary: the kernels are linked once.

mod absent_terms;
mod appendages;
mod batch;
mod cases;
mod control;
mod description;
mod double_double;
mod dynamics;
mod estimate;
mod examples;
mod forward_damping;
mod golden;
mod hydro;
mod lane;
mod laws;
mod lie;
mod random_scene;
mod render;
mod source;
mod spatial;
mod stability;
mod system;
mod task;
mod thrusters;
mod urdf;

//! Integration tests of the library, in one binary: the kernels are linked once.

mod absent_terms;
mod appendages;
mod articulated;
mod batches;
mod cases;
mod chains;
mod closed_form;
mod descriptions;
mod estimates;
mod golden;
mod implicit;
mod lanes;
mod laws;
mod layers;
mod lie;
mod malformed_scenes;
mod momentum;
mod plausible;
mod policies;
mod random_scene;
mod spatial;
mod stability;
mod task_batch;
mod thrusters;
mod urdf;

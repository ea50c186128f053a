//! Shared by the tests.

pub mod random_scene;

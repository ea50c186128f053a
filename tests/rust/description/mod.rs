//! Scenes as data: reading, checking, warnings.

use uvms_gym::description::Scene;

mod axes;
mod compose;
mod compose_errors;
mod contact;
mod malformed_scenes;
mod path;
mod plausible;
mod scenes;

fn shipped(name: &str) -> Scene {
    Scene::shipped(name).unwrap_or_else(|error| panic!("{error}"))
}

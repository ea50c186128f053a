//! Scenes as data: reading, checking, warnings.

mod malformed_scenes;
mod path;
mod plausible;
mod scenes;

//! Scenes as data: reading, checking, warnings.

mod axes;
mod malformed_scenes;
mod path;
mod plausible;
mod scenes;

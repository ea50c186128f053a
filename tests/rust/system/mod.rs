//! Compiled scenes.

mod chains;
mod propulsion;

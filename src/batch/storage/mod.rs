//! Storage: the numbers of all instances in blocks, access to them by lanes and by instance, and loads from inputs to rows.

pub mod aligned;
pub mod columns;
mod fill;
pub mod inputs;
pub mod layout;
pub mod own_numbers;
pub mod own_scenes;
pub mod table;

//! Many instances at a time: blocks of lanes, threads.

mod blocks;
mod dynamics;
mod layout;

mod step;
mod threads;

pub use layout::Layout;


//! Limits of computations: interrupts and memory.

pub mod interrupt;
pub mod memory;

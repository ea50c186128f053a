//! Many instances at once.

mod aligned;
mod fill;
mod instances;
mod precision;
mod task;
mod threads;

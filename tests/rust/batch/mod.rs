//! Many instances at once.

mod instances;
mod task;

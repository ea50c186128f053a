//! The closed form against laws, hand calculation and the literature.

mod awkward_scene;
mod composition;
mod ledger;
mod motion;
mod water;

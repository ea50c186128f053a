//! Contact against closed forms, conservation laws and its dense twin.

mod bounce;
mod friction;
mod laws;
mod scenes;
mod twin;

pub use scenes::wrestling;

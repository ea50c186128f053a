//! Contact against closed forms, conservation laws and its dense twin.

mod bounce;
mod friction;
mod implicit;
mod laws;
mod scenes;
mod twin;

pub use scenes::wrestling;

//! The linearly implicit method: its kernel against dense matrices, its order, and stiff cases.

mod kernel;
mod order;
mod scenes;
mod stiff;

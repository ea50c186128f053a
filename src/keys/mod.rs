//! Keys of scene files: short forms of vectors and matrices, checks that name the key, axes.

mod axes;
mod fault;
pub(crate) mod numbers;
mod tree;

pub use axes::{flip, flip_matrix, flip_six, normalise};
pub use fault::{Fault, check_axis, check_names, check_not_negative, none_of, range};
pub(crate) use tree::read_tree;

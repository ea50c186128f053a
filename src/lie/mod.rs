//! The rotation group SO(3) and the Euclidean group SE(3), in lanes.
//!
//! Twists and wrenches are pairs of 3-vectors. Adjoints act through R and r and are never assembled as 6x6 matrices.

mod exponential;
mod exponential_adjoint;
mod logarithm;
mod se3;
mod so3;

pub use exponential::{DexpInverse, dexp_inverse_negative, exp_se3, rotate_back};
pub use exponential_adjoint::{ad_adjoint, dexp_inverse_adjoint, increment_adjoint, rotate_back_adjoint};
pub use logarithm::{rotation_angle, rotation_vector, rotation_vector_and_angle};
pub use se3::{Pose, Vector6, ad};
pub use so3::{Matrix3, Vector3};

//! Bodies, joints and poses as dense f64 matrices: the ingredients of the closed form, independent of the lane kernels.

mod contact;
mod joint;
mod rigid_body;
mod se3;

pub use contact::{DenseContact, MovingFrame};
pub use joint::{EndStop, actuator_torque, friction, joint_axis, joint_pose, spring};
pub use rigid_body::{DenseBody, relative_twist};
pub use se3::{DensePose, ad, angular, blocks, force_at, linear, stack};

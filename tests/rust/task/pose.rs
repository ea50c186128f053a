//! Poses of rigid frames in the world, and their errors.

use nalgebra as na;
use uvms_gym::lie::Vector3;
use uvms_gym::task::*;

#[test]
fn error_of_a_pose_is_seen_from_its_own_axes() {
    let turn = |x, y, z| na::Rotation3::from_scaled_axis(na::Vector3::new(x, y, z)).into_inner();
    let target = Pose { position: na::Vector3::new(1.0, 2.0, 3.0), rotation: turn(0.3, -0.2, 0.9) };
    let rotation = target.rotation * turn(0.0, 0.0, 0.1);
    let pose = Pose { position: target.position + rotation * na::Vector3::new(0.5, 0.0, 0.0), rotation };
    let error = PoseError::of(&pose.in_lanes(), &target.in_lanes());
    assert!((error.position - Vector3([0.5, 0.0, 0.0])).0.iter().all(|x| x.abs() < 1e-15));
    assert!((error.rotation - Vector3([0.0, 0.0, 0.1])).0.iter().all(|x| x.abs() < 1e-15));
}

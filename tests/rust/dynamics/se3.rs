//! SE(3) as dense matrices.

use nalgebra::{Matrix6, Vector3, Vector6};
use uvms_gym::description::Frame;
use uvms_gym::dynamics::dense::{DensePose, ad, angular, linear};

fn pose() -> DensePose {
    let frame = Frame { position: Vector3::new(0.3, -0.7, 1.1), rpy: Vector3::new(0.4, -1.2, 2.3) };
    DensePose::from_frame(&frame)
}

#[test]
fn adjoints_compose_as_poses_do() {
    let other = DensePose { position: Vector3::new(-2.0, 0.1, 0.4), ..DensePose::turn(&Vector3::y(), 0.8) };
    let difference = (pose() * other).adjoint() - pose().adjoint() * other.adjoint();
    assert!(difference.norm() < 1e-14);
    assert!((pose().adjoint() * pose().adjoint_inverse() - Matrix6::identity()).norm() < 1e-14);
}

#[test]
fn rpy_is_yaw_after_pitch_after_roll() {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    let expected = DensePose::turn(&z, 2.3) * DensePose::turn(&y, -1.2) * DensePose::turn(&x, 0.4);
    assert!((pose().rotation - expected.rotation).norm() < 1e-14);
    // A quarter turn of yaw takes x to y.
    assert!((DensePose::turn(&z, std::f64::consts::FRAC_PI_2).rotation * x - y).norm() < 1e-15);
}

#[test]
fn wrenches_are_dual_to_twists() {
    let twist = Vector6::new(0.1, 0.2, -0.3, 0.4, 0.5, 0.6);
    let wrench = Vector6::new(3.0, -1.0, 2.0, 0.7, 0.2, -0.9);
    let here = wrench.dot(&twist);
    let there = pose().wrench_to_parent(&wrench).dot(&(pose().adjoint() * twist));
    assert!((here - there).abs() < 1e-13);
    // A force has the lever arm that it should.
    let moved = DensePose::shift(Vector3::x()).wrench_to_parent(&Vector6::new(0.0, 2.0, 0.0, 0.0, 0.0, 0.0));
    assert_eq!(moved, Vector6::new(0.0, 2.0, 0.0, 0.0, 0.0, 2.0));
}

#[test]
fn ad_is_the_derivative_of_the_adjoint() {
    let twist = Vector6::new(0.1, 0.2, -0.3, 0.4, 0.5, 0.6);
    let h = 1e-6;
    let step = |s: f64| {
        let omega = angular(&twist);
        let turned = DensePose::turn(&omega.normalize(), s * omega.norm());
        DensePose { position: linear(&twist) * s, ..turned }.adjoint()
    };
    let derivative = (step(h) - step(-h)) / (2.0 * h);
    assert!((derivative - ad(&twist)).norm() < 1e-9);
}

//! Attitude as people read it: quaternion and rotation vector, across their switches.

use std::f64::consts::PI;

use nalgebra as na;
use uvms_gym::lie::{self, exp_se3};
use uvms_gym::system::{quaternion, rotation, rotation_vector};

use super::{angles, dense, lanes, rows};
use crate::random_scene::Random;

fn turned(w: &na::Vector3<f64>) -> na::Matrix3<f64> {
    dense(&exp_se3(lanes(&na::Vector6::new(0.0, 0.0, 0.0, w.x, w.y, w.z))).rotation)
}

/// The logarithms: of scalars and of lanes.
type Logarithm = fn(&na::Matrix3<f64>) -> na::Vector3<f64>;
const LOGARITHMS: [Logarithm; 2] = [rotation_vector, logarithm];

fn logarithm(r: &na::Matrix3<f64>) -> na::Vector3<f64> {
    let r = rows(r);
    let vector = lie::rotation_vector(&r);
    let length = na::Vector3::from(vector.0).norm();
    assert!((lie::rotation_angle(&r) - length).abs() <= 1e-15 * length);
    vector.0.into()
}

/// Directions in general position and along axes, planes and diagonals, where the largest component changes.
fn directions() -> Vec<na::Vector3<f64>> {
    let mut random = Random::new(1);
    let grid = (0..27).filter(|k| *k != 13).map(|k| na::Vector3::new(k % 3, k / 3 % 3, k / 9));
    let corners = grid.map(|v| v.map(|x| f64::from(x) - 1.0).normalize());
    (0..20).map(|_| random.direction()).chain(corners).collect()
}

#[test]
fn rotation_vector_is_the_logarithm() {
    let mut worst = 0.0_f64;
    for direction in directions() {
        // Its series ends where the sine of half the angle is 1e-4; a finer grid there.
        for angle in angles(1e-12, PI - 1e-6, 400).chain(angles(1.99e-4, 2.01e-4, 200)) {
            let w = direction * angle;
            for log in LOGARITHMS {
                let error = (log(&turned(&w)) - w).norm();
                // A rotation matrix holds a small angle to rounding of the angle itself.
                assert!(error < 2e-15 * angle, "{angle}: {error:e}");
                worst = worst.max(error / angle);
            }
        }
    }
    println!("rotation vector: maximum relative error {worst:e}");
    assert!(LOGARITHMS.iter().all(|log| log(&na::Matrix3::identity()) == na::Vector3::zeros()));
}

#[test]
fn half_turn_has_a_rotation_vector_of_either_sign() {
    for direction in directions() {
        for log in LOGARITHMS {
            let w = log(&turned(&(direction * PI)));
            assert!((w.norm() - PI).abs() < 1e-14, "{w}");
            assert!((turned(&w) - turned(&(direction * PI))).amax() < 4e-15);
            assert!(w.cross(&direction).norm() < 1e-14);
        }
    }
}

#[test]
fn quaternion_is_half_the_angle_at_every_angle() {
    for direction in directions() {
        for angle in angles(1e-12, PI - 1e-9, 400).chain(angles(2.0 * PI / 3.0 - 1e-6, 2.0 * PI / 3.0 + 1e-6, 50)) {
            let got = na::Vector4::from(quaternion(&turned(&(direction * angle))));
            let (sin, cos) = (0.5 * angle).sin_cos();
            let e = direction * sin;
            let expected = na::Vector4::new(cos, e.x, e.y, e.z);
            assert!((got - expected).amax() < 1e-15, "{angle} about {direction}: {got} {expected}");
            assert!(got[0] >= 0.0 && (got.norm() - 1.0).abs() < 4e-16);
        }
    }
}

#[test]
fn quaternion_and_rotation_are_inverse() {
    let mut random = Random::new(2);
    for _ in 0..2000 {
        let r = random.rotation();
        assert!((rotation(&quaternion(&r)) - r).amax() < 1e-15);
        let q = quaternion(&r).map(|x| 3.7 * x);
        assert!((rotation(&q) - r).amax() < 1e-15, "its length does not matter");
        let lib = na::UnitQuaternion::from_matrix(&r);
        let sign = if lib.w < 0.0 { -1.0 } else { 1.0 };
        let lib = na::Vector4::new(lib.w, lib.i, lib.j, lib.k) * sign;
        assert!((na::Vector4::from(quaternion(&r)) - lib).amax() < 1e-12);
    }
}

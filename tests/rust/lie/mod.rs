//! SO(3) and SE(3) against the series that define them, outside numbers and the laws of the group.

mod attitude;
mod exponential;
mod group;
mod inverse;

use crate::random_scene::Random;
use nalgebra as na;
use uvms_gym::dynamics::dense::{DensePose, ad as ad_matrix};
use uvms_gym::lie::{Matrix3, Pose, Vector3, Vector6};

/// `sum coefficient(k) m^k`, with as many terms as ever count.
fn series<const N: usize>(m: &na::SMatrix<f64, N, N>, coefficient: impl Fn(usize) -> f64) -> na::SMatrix<f64, N, N> {
    let mut power = na::SMatrix::identity();
    let mut sum = na::SMatrix::zeros();
    for k in 0..150 {
        sum += power * coefficient(k);
        power *= *m;
    }
    sum
}

/// 1 / k!
fn over_factorial(k: usize) -> f64 {
    (1..=k).map(|i| 1.0 / i as f64).product()
}

/// `[xi]`, 4x4.
fn hat(xi: &na::Vector6<f64>) -> na::Matrix4<f64> {
    let mut m = na::Matrix4::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(&xi.fixed_rows::<3>(3).into_owned().cross_matrix());
    m.fixed_view_mut::<3, 1>(0, 3).copy_from(&xi.fixed_rows::<3>(0));
    m
}

/// `Ad_T`, 6x6.
pub fn adjoint(pose: &Pose<f64>) -> na::Matrix6<f64> {
    DensePose { rotation: dense(&pose.rotation), position: pose.position.0.into() }.adjoint()
}

/// `dexp_(-theta) = sum (-ad)^k / (k+1)!`: d(theta)/dt to the body twist of exp [theta].
fn dexp_negative(theta: &na::Vector6<f64>) -> na::Matrix6<f64> {
    series(&-ad_matrix(theta), |k| over_factorial(k + 1))
}

fn dense(m: &Matrix3<f64>) -> na::Matrix3<f64> {
    na::Matrix3::from_fn(|i, k| m.0[i][k])
}

/// A matrix by rows.
pub fn rows(m: &na::Matrix3<f64>) -> Matrix3<f64> {
    Matrix3((*m).transpose().into())
}

pub fn lanes(x: &na::Vector6<f64>) -> Vector6<f64> {
    Vector6::from_array((*x).into())
}

pub fn six(x: Vector6<f64>) -> na::Vector6<f64> {
    x.to_array().into()
}

/// A random 6-vector whose rotation part has length `angle`.
fn of_angle(random: &mut Random, angle: f64) -> na::Vector6<f64> {
    let (v, w) = (random.vector(1.0), random.direction() * angle);
    na::Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
}

fn random_pose(random: &mut Random) -> Pose<f64> {
    let (r, p) = (random.rotation(), random.vector(2.0));
    Pose { rotation: rows(&r), position: Vector3(p.into()) }
}

/// Angles from `minimum` to `maximum` in equal ratios.
fn angles(minimum: f64, maximum: f64, count: usize) -> impl Iterator<Item = f64> {
    (0..count).map(move |i| minimum * (maximum / minimum).powf(i as f64 / (count - 1) as f64))
}

//! SE(3) as dense f64 matrices, independent of the lane kernels.

use std::ops::Mul;

use nalgebra::{Matrix3, Matrix6, Rotation3, Unit, Vector3, Vector6};

use crate::description::Frame;

/// A pose `(R, r)` of one frame in another. `[HC eq. 1]`
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DensePose {
    /// Rotation from the frame's axes to the parent's.
    pub rotation: Matrix3<f64>,
    /// Origin in the parent frame, m.
    pub position: Vector3<f64>,
}

impl DensePose {
    /// Pose of the reference frame itself.
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), position: Vector3::zeros() }
    }

    /// Constant frame of a scene: `R = Rz(yaw) Ry(pitch) Rx(roll)`.
    pub fn from_frame(frame: &Frame) -> Self {
        Self { rotation: frame.rotation(), position: frame.position }
    }

    /// Rotation by `angle` (rad) about the unit vector `axis` through the origin.
    pub fn turn(axis: &Vector3<f64>, angle: f64) -> Self {
        let rotation = Rotation3::from_axis_angle(&Unit::new_unchecked(*axis), angle);
        Self { rotation: rotation.into_inner(), position: Vector3::zeros() }
    }

    /// Translation by `displacement`, m.
    pub fn shift(displacement: Vector3<f64>) -> Self {
        Self { rotation: Matrix3::identity(), position: displacement }
    }

    /// Inverse: pose of the parent in this frame.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, position: -(rotation * self.position) }
    }

    /// `Ad = [[R, [r] R], [0, R]]`, which takes twists of this frame to the parent's. `[HC eq. 8]`
    pub fn adjoint(&self) -> Matrix6<f64> {
        blocks(self.rotation, self.position.cross_matrix() * self.rotation, Matrix3::zeros(), self.rotation)
    }

    /// `Ad^-1`, which takes twists of the parent to this frame's. `[HC eq. 7]`
    pub fn adjoint_inverse(&self) -> Matrix6<f64> {
        self.inverse().adjoint()
    }

    /// `Ad^-T F`: the wrench at the parent frame of a wrench at this frame. `[HC eq. 12]`
    pub fn wrench_to_parent(&self, wrench: &Vector6<f64>) -> Vector6<f64> {
        self.adjoint_inverse().tr_mul(wrench)
    }
}

impl Mul for DensePose {
    type Output = Self;

    fn mul(self, child: Self) -> Self {
        Self { rotation: self.rotation * child.rotation, position: self.rotation * child.position + self.position }
    }
}

/// `ad_V = [[ [omega], [v] ], [0, [omega]]]`. `[MLS94]`
pub fn ad(twist: &Vector6<f64>) -> Matrix6<f64> {
    let omega = angular(twist).cross_matrix();
    blocks(omega, linear(twist).cross_matrix(), Matrix3::zeros(), omega)
}

/// Linear part: the first three entries of a 6-vector.
#[inline]
pub fn linear(x: &Vector6<f64>) -> Vector3<f64> {
    x.fixed_rows::<3>(0).into_owned()
}

/// Angular part: the last three entries of a 6-vector.
#[inline]
pub fn angular(x: &Vector6<f64>) -> Vector3<f64> {
    x.fixed_rows::<3>(3).into_owned()
}

/// 6-vector `[linear; angular]`.
#[inline]
pub fn stack(linear: &Vector3<f64>, angular: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}

/// Wrench at the origin of a `force` acting at `point`.
pub fn force_at(force: &Vector3<f64>, point: &Vector3<f64>) -> Vector6<f64> {
    stack(force, &point.cross(force))
}

/// 6x6 matrix `[[a, b], [c, d]]` of 3x3 blocks.
pub fn blocks(a: Matrix3<f64>, b: Matrix3<f64>, c: Matrix3<f64>, d: Matrix3<f64>) -> Matrix6<f64> {
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(&a);
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(&b);
    m.fixed_view_mut::<3, 3>(3, 0).copy_from(&c);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(&d);
    m
}

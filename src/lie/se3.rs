//! Poses and their adjoint action.

use std::ops::{Add, Neg, Sub};

use super::{Matrix3, Vector3};
use crate::lane::{Lane, Param, get_all};

/// A pair `[linear; angular]`: a body twist `[v; omega]` or its rate, or a body wrench `[f; m]`. `[HC eq. 2, 6]`
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vector6<L> {
    /// `v` or `f`.
    pub linear: Vector3<L>,
    /// `omega` or `m`.
    pub angular: Vector3<L>,
}

impl<L: Lane> Vector6<L> {
    /// The zero vector.
    #[inline(always)]
    pub fn zero() -> Self {
        Self { linear: Vector3::zero(), angular: Vector3::zero() }
    }

    /// From an array.
    #[inline(always)]
    pub fn from_array(x: [L; 6]) -> Self {
        Self { linear: Vector3([x[0], x[1], x[2]]), angular: Vector3([x[3], x[4], x[5]]) }
    }

    /// To an array.
    #[inline(always)]
    pub fn to_array(self) -> [L; 6] {
        let (v, w) = (self.linear.0, self.angular.0);
        [v[0], v[1], v[2], w[0], w[1], w[2]]
    }

    /// Inner product; power, for a twist and a wrench.
    #[inline(always)]
    pub fn dot(self, b: Self) -> L {
        self.linear.dot(b.linear) + self.angular.dot(b.angular)
    }

    /// `self * s + b`
    #[inline(always)]
    pub fn scale_add(self, s: L, b: Self) -> Self {
        Self { linear: self.linear.scale_add(s, b.linear), angular: self.angular.scale_add(s, b.angular) }
    }

    /// `self * s`
    #[inline(always)]
    pub fn scale(self, s: L) -> Self {
        Self { linear: self.linear.scale(s), angular: self.angular.scale(s) }
    }
}

impl<L: Lane> Matrix3<L> {
    /// Both parts of a 6-vector, rotated.
    #[inline(always)]
    pub fn apply_both(&self, x: Vector6<L>) -> Vector6<L> {
        Vector6 { linear: self.apply(x.linear), angular: self.apply(x.angular) }
    }

    /// Both parts of a 6-vector, rotated back.
    #[inline(always)]
    pub fn apply_both_transposed(&self, x: Vector6<L>) -> Vector6<L> {
        Vector6 { linear: self.apply_transposed(x.linear), angular: self.apply_transposed(x.angular) }
    }
}

impl<L: Lane> Add for Vector6<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self { linear: self.linear + b.linear, angular: self.angular + b.angular }
    }
}

impl<L: Lane> Sub for Vector6<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self { linear: self.linear - b.linear, angular: self.angular - b.angular }
    }
}

impl<L: Lane> Neg for Vector6<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { linear: -self.linear, angular: -self.angular }
    }
}

/// `ad_a b = [omega_a x v_b + v_a x omega_b; omega_a x omega_b]`, `[MLS94 eq. 2.58]`
#[inline(always)]
pub fn ad<L: Lane>(a: Vector6<L>, b: Vector6<L>) -> Vector6<L> {
    Vector6 { linear: a.angular.cross_add(b.linear, a.linear.cross(b.angular)), angular: a.angular.cross(b.angular) }
}

/// A pose `T = (R, r)`, which maps coordinates of the child frame to the parent frame. `[HC eq. 1]`
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose<L> {
    /// R.
    pub rotation: Matrix3<L>,
    /// r.
    pub position: Vector3<L>,
}

impl<L: Lane> Pose<L> {
    /// Pose of the reference frame itself.
    #[inline(always)]
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), position: Vector3::zero() }
    }

    /// From parameters: rotation by rows, position.
    #[inline(always)]
    pub fn of<P: Param<L>>(rotation: &[[P; 3]; 3], position: &[P; 3]) -> Self {
        let rows = [get_all(&rotation[0]), get_all(&rotation[1]), get_all(&rotation[2])];
        Self { rotation: Matrix3(rows), position: Vector3(get_all(position)) }
    }

    /// `self * b`
    #[inline(always)]
    pub fn times(&self, b: &Self) -> Self {
        Self { rotation: self.rotation.times(&b.rotation), position: self.rotation.apply(b.position) + self.position }
    }

    /// `Ad_T^-1 V`: transforms a twist from the parent frame to the child frame. `[HC eq. 7, 8]`
    #[inline(always)]
    pub fn adjoint_apply_inverse(&self, twist: Vector6<L>) -> Vector6<L> {
        Vector6 {
            linear: self.rotation.apply_transposed(twist.angular.cross_add(self.position, twist.linear)),
            angular: self.rotation.apply_transposed(twist.angular),
        }
    }

    /// `Ad_T^-T F`: transforms a wrench from the child frame to the parent frame. `[HC eq. 12]`
    #[inline(always)]
    pub fn co_adjoint_apply_inverse(&self, wrench: Vector6<L>) -> Vector6<L> {
        let linear = self.rotation.apply(wrench.linear);
        Vector6 { linear, angular: self.position.cross_add(linear, self.rotation.apply(wrench.angular)) }
    }
}

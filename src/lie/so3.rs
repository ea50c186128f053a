//! 3-vectors and 3x3 matrices in lanes.

use std::ops::{Add, Neg, Sub};

use crate::lane::{Lane, unroll};

/// A 3-vector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vector3<L>(pub [L; 3]);

impl<L: Lane> Vector3<L> {
    /// The zero vector.
    #[inline(always)]
    pub fn zero() -> Self {
        Self([L::zero(); 3])
    }

    /// `self x b`
    #[inline(always)]
    pub fn cross(self, b: Self) -> Self {
        let (a, b) = (self.0, b.0);
        Self([
            a[1].mul_add(b[2], -(a[2] * b[1])),
            a[2].mul_add(b[0], -(a[0] * b[2])),
            a[0].mul_add(b[1], -(a[1] * b[0])),
        ])
    }

    /// `self x b + c`
    #[inline(always)]
    pub fn cross_add(self, b: Self, c: Self) -> Self {
        let (a, b, c) = (self.0, b.0, c.0);
        Self([
            a[1].mul_add(b[2], a[2].neg_mul_add(b[1], c[0])),
            a[2].mul_add(b[0], a[0].neg_mul_add(b[2], c[1])),
            a[0].mul_add(b[1], a[1].neg_mul_add(b[0], c[2])),
        ])
    }

    /// Inner product.
    #[inline(always)]
    pub fn dot(self, b: Self) -> L {
        let (a, b) = (self.0, b.0);
        a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
    }

    /// `self * s`
    #[inline(always)]
    pub fn scale(self, s: L) -> Self {
        let a = self.0;
        Self([a[0] * s, a[1] * s, a[2] * s])
    }

    /// `self * s + b`
    #[inline(always)]
    pub fn scale_add(self, s: L, b: Self) -> Self {
        let (a, b) = (self.0, b.0);
        Self([a[0].mul_add(s, b[0]), a[1].mul_add(s, b[1]), a[2].mul_add(s, b[2])])
    }
}

impl<L: Lane> Add for Vector3<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        let (a, b) = (self.0, b.0);
        Self([a[0] + b[0], a[1] + b[1], a[2] + b[2]])
    }
}

impl<L: Lane> Sub for Vector3<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        let (a, b) = (self.0, b.0);
        Self([a[0] - b[0], a[1] - b[1], a[2] - b[2]])
    }
}

impl<L: Lane> Neg for Vector3<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        let a = self.0;
        Self([-a[0], -a[1], -a[2]])
    }
}

/// A 3x3 matrix, by rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Matrix3<L>(pub [[L; 3]; 3]);

impl<L: Lane> Matrix3<L> {
    /// The identity.
    #[inline(always)]
    pub fn identity() -> Self {
        let (o, i) = (L::zero(), L::c(1.0));
        Self([[i, o, o], [o, i, o], [o, o, i]])
    }

    /// The symmetric matrix of `xx, xy, xz, yy, yz, zz`.
    #[inline(always)]
    pub fn symmetric(s: &[L; 6]) -> Self {
        Self([[s[0], s[1], s[2]], [s[1], s[3], s[4]], [s[2], s[4], s[5]]])
    }

    /// `self * v`
    #[inline(always)]
    pub fn apply(&self, v: Vector3<L>) -> Vector3<L> {
        let m = &self.0;
        Vector3([Vector3(m[0]).dot(v), Vector3(m[1]).dot(v), Vector3(m[2]).dot(v)])
    }

    /// `self^T * v`
    #[inline(always)]
    pub fn apply_transposed(&self, v: Vector3<L>) -> Vector3<L> {
        self.transposed().apply(v)
    }

    /// `self * b`
    #[inline(always)]
    pub fn times(&self, b: &Self) -> Self {
        let (m, b) = (&self.0, b.transposed());
        Self([b.apply(Vector3(m[0])).0, b.apply(Vector3(m[1])).0, b.apply(Vector3(m[2])).0])
    }

    /// The transpose.
    #[inline(always)]
    pub fn transposed(&self) -> Self {
        let m = &self.0;
        Self([[m[0][0], m[1][0], m[2][0]], [m[0][1], m[1][1], m[2][1]], [m[0][2], m[1][2], m[2][2]]])
    }

    /// One Newton step towards the nearest rotation, `R (3 I - R^T R) / 2`: removes the rounding of many products.
    #[inline(always)]
    pub fn orthonormalised(&self) -> Self {
        let columns = self.transposed().0;
        let mut s = Self::identity();
        unroll!(i in 0 1 2 => {
            for j in i..3 {
                let unit = if i == j { 1.5 } else { 0.0 };
                let entry = Vector3(columns[i]).dot(Vector3(columns[j])).mul_add(L::c(-0.5), L::c(unit));
                s.0[i][j] = entry;
                s.0[j][i] = entry;
            }
        });
        self.times(&s)
    }
}

//! The moves of a modified Denavit-Hartenberg link, `T = Rx(alpha) Tx(a) Rz(theta) Tz(d)`: a screw about x, then one
//! about z. Each touches a plane and an axis only, which is what makes it cheaper than a general change of frame.

use super::SpatialInertia;
use crate::lane::{Lane, Param};
use crate::lie::{Matrix3, Vector3, Vector6};

/// Twist angle alpha of a link, with the two cases that most arms are made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bend<P> {
    /// Parallel axes: alpha = 0.
    Flat,
    /// Perpendicular axes: alpha = pi/2.
    Quarter,
    /// Any other: sine and cosine.
    General(P, P),
}

impl<P: Copy> Bend<P> {
    /// The same bend with its numbers changed.
    pub fn map<Q>(&self, mut change: impl FnMut(P) -> Q) -> Bend<Q> {
        match *self {
            Bend::Flat => Bend::Flat,
            Bend::Quarter => Bend::Quarter,
            Bend::General(s, c) => Bend::General(change(s), change(c)),
        }
    }
}

/// Rotation in the plane of two axes followed by `along`, as `x` (plane yz) or `z` (plane xy).
#[derive(Debug, Clone, Copy)]
pub struct Axis<L> {
    turn: Turn<L>,
    shift: L,
    /// The two axes of the plane and the axis along.
    axes: [usize; 3],
}

#[derive(Debug, Clone, Copy)]
enum Turn<L> {
    None,
    Quarter,
    By(L, L),
}

/// `Rx(alpha) Tx(a)`.
#[inline(always)]
pub fn screw_x<L: Lane, P: Param<L>>(bend: Bend<P>, a: P) -> Axis<L> {
    let turn = match bend {
        Bend::Flat => Turn::None,
        Bend::Quarter => Turn::Quarter,
        Bend::General(s, c) => Turn::By(s.get(), c.get()),
    };
    Axis { turn, shift: a.get(), axes: [1, 2, 0] }
}

/// `Rz(theta) Tz(d)`, theta by its sine and cosine.
#[inline(always)]
pub fn screw_z<L: Lane>(sin: L, cos: L, d: L) -> Axis<L> {
    Axis { turn: Turn::By(sin, cos), shift: d, axes: [0, 1, 2] }
}

impl<L: Lane> Axis<L> {
    /// A vector of the child, in parent axes.
    #[inline(always)]
    pub fn rotate(&self, v: Vector3<L>) -> Vector3<L> {
        let [i, k, n] = self.axes;
        let mut out = v;
        match self.turn {
            Turn::None => {}
            Turn::Quarter => {
                out.0[i] = -v.0[k];
                out.0[k] = v.0[i];
            }
            Turn::By(s, c) => {
                out.0[i] = c.mul_add(v.0[i], -(s * v.0[k]));
                out.0[k] = s.mul_add(v.0[i], c * v.0[k]);
            }
        }
        out.0[n] = v.0[n];
        out
    }

    /// A vector of the parent, in child axes.
    #[inline(always)]
    pub fn rotate_back(&self, v: Vector3<L>) -> Vector3<L> {
        let [i, k, n] = self.axes;
        let mut out = v;
        match self.turn {
            Turn::None => {}
            Turn::Quarter => {
                out.0[i] = v.0[k];
                out.0[k] = -v.0[i];
            }
            Turn::By(s, c) => {
                out.0[i] = c.mul_add(v.0[i], s * v.0[k]);
                out.0[k] = c.mul_add(v.0[k], -(s * v.0[i]));
            }
        }
        out.0[n] = v.0[n];
        out
    }

    /// `Ad^-1 V`: a twist of the parent frame, in the child frame.
    #[inline(always)]
    pub fn adjoint_apply_inverse(&self, twist: Vector6<L>) -> Vector6<L> {
        let [i, k, _] = self.axes;
        let angular = self.rotate_back(twist.angular);
        let mut linear = self.rotate_back(twist.linear);
        // v + omega x (shift along the axis)
        linear.0[i] = angular.0[k].mul_add(self.shift, linear.0[i]);
        linear.0[k] = angular.0[i].neg_mul_add(self.shift, linear.0[k]);
        Vector6 { linear, angular }
    }

    /// `Ad^-T F`: a wrench on the child frame, in the parent frame.
    #[inline(always)]
    pub fn co_adjoint_apply_inverse(&self, wrench: Vector6<L>) -> Vector6<L> {
        let [i, k, _] = self.axes;
        let (f, mut m) = (wrench.linear, wrench.angular);
        // m + (shift along the axis) x f
        m.0[i] = f.0[k].neg_mul_add(self.shift, m.0[i]);
        m.0[k] = f.0[i].mul_add(self.shift, m.0[k]);
        Vector6 { linear: self.rotate(f), angular: self.rotate(m) }
    }

    /// `Ad^-T A Ad^-1`: an inertia of the child frame, in the parent frame.
    #[inline(always)]
    pub fn inertia_to_parent(&self, inertia: &SpatialInertia<L>) -> SpatialInertia<L> {
        let shifted = self.shift_inertia(inertia);
        SpatialInertia {
            m: self.turn_symmetric(&shifted.m),
            h: self.turn_full(&shifted.h),
            j: self.turn_symmetric(&shifted.j),
        }
    }

    /// Shift along the axis: `H' = H - M [r]`, `J' = J - H^T [r] + [r] H'`.
    #[inline(always)]
    fn shift_inertia(&self, a: &SpatialInertia<L>) -> SpatialInertia<L> {
        use super::inertia::PACKED;
        let [i, k, n] = self.axes;
        let d = self.shift;
        let mut b = *a;
        for row in 0..3 {
            b.h[row][i] = a.m[PACKED[row][k]].neg_mul_add(d, a.h[row][i]);
            b.h[row][k] = a.m[PACKED[row][i]].mul_add(d, a.h[row][k]);
        }
        let (ii, ik, inn, kk, kn) = (PACKED[i][i], PACKED[i][k], PACKED[i][n], PACKED[k][k], PACKED[k][n]);
        b.j[ii] = (a.h[k][i] + b.h[k][i]).neg_mul_add(d, a.j[ii]);
        b.j[ik] = (a.h[i][i] - b.h[k][k]).mul_add(d, a.j[ik]);
        b.j[kk] = (a.h[i][k] + b.h[i][k]).mul_add(d, a.j[kk]);
        b.j[inn] = b.h[k][n].neg_mul_add(d, a.j[inn]);
        b.j[kn] = b.h[i][n].mul_add(d, a.j[kn]);
        b
    }

    /// `R S R^T` of a symmetric matrix.
    #[inline(always)]
    fn turn_symmetric(&self, s: &[L; 6]) -> [L; 6] {
        use super::inertia::PACKED;
        let [i, k, n] = self.axes;
        let (ii, ik, kk, inn, kn) = (PACKED[i][i], PACKED[i][k], PACKED[k][k], PACKED[i][n], PACKED[k][n]);
        let mut out = *s;
        match self.turn {
            Turn::None => {}
            Turn::Quarter => {
                out[ii] = s[kk];
                out[kk] = s[ii];
                out[ik] = -s[ik];
                out[inn] = -s[kn];
                out[kn] = s[inn];
            }
            Turn::By(sin, cos) => {
                let difference = s[ii] - s[kk];
                // With t = sin (difference) + 2 cos S_ik: S_kk' = S_kk + sin t, S_ii' = S_ii - sin t.
                let t = sin.mul_add(difference, (cos + cos) * s[ik]);
                out[ii] = sin.neg_mul_add(t, s[ii]);
                out[kk] = sin.mul_add(t, s[kk]);
                out[ik] = cos.mul_add(t, -s[ik]);
                out[inn] = cos.mul_add(s[inn], -(sin * s[kn]));
                out[kn] = sin.mul_add(s[inn], cos * s[kn]);
            }
        }
        out
    }

    /// `H R^T`
    #[inline(always)]
    fn rotate_rows(&self, h: &Matrix3<L>) -> Matrix3<L> {
        let h = &h.0;
        Matrix3([self.rotate(Vector3(h[0])).0, self.rotate(Vector3(h[1])).0, self.rotate(Vector3(h[2])).0])
    }

    /// `R H R^T` of a full matrix.
    #[inline(always)]
    fn turn_full(&self, h: &[[L; 3]; 3]) -> [[L; 3]; 3] {
        self.rotate_rows(&self.rotate_rows(&Matrix3(*h)).transposed()).transposed().0
    }
}

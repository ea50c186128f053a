//! Screw transforms of a modified Denavit-Hartenberg link, `T = Rx(alpha) Tx(a) Rz(theta) Tz(d)`: one about x, one about z.
//! Each rotates a plane and translates along an axis, which makes it cheaper than a general change of frame.

use std::hint::cold_path;

use super::SpatialInertia;
use super::inertia::PACKED;
use crate::lane::{Lane, Param, numbers, unroll};
use crate::lie::{Vector3, Vector6};

numbers! {
    /// Rotation angle of a constant screw (alpha, the link twist, of a screw about x), with the common cases apart.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub enum LinkTwist<P> {
        /// 0: parallel axes.
        Deg0,
        /// pi/2: perpendicular axes.
        Deg90,
        /// pi: opposite axes.
        Deg180,
        /// Any other angle, by its sine and cosine.
        General(sin: P, cos: P),
    }
}

/// Rotation about an axis and translation along it, absent where it is 0. `ALONG` is the axis, 0 for x, 2 for z: a constant, so
/// that every index below is one. Both are parameters, or numbers per lane. Parameters are read where they are used, so that
/// they occupy no registers in between.
#[derive(Debug, Clone, Copy)]
pub struct Screw<T, S, const ALONG: usize> {
    pub(super) rotation: LinkTwist<T>,
    pub(super) translation: Option<S>,
}

/// `Rx(alpha) Tx(a)`.
#[inline(always)]
pub fn screw_x<P>(twist: LinkTwist<P>, a: Option<P>) -> Screw<P, P, 0> {
    Screw { rotation: twist, translation: a }
}

/// `Rz(theta) Tz(d)` with a constant theta.
#[inline(always)]
pub fn constant_screw_z<P>(twist: LinkTwist<P>, d: Option<P>) -> Screw<P, P, 2> {
    Screw { rotation: twist, translation: d }
}

/// `Rz(theta) Tz(d)`, with theta by its sine and cosine.
#[inline(always)]
pub fn screw_z<T, S>(sin: T, cos: T, d: Option<S>) -> Screw<T, S, 2> {
    Screw { rotation: LinkTwist::General(sin, cos), translation: d }
}

/// Rotation of vectors in the plane of a screw: entries (a, b) by a quarter turn, and by the sine s and cosine c of any angle.
macro_rules! rotation {
    ($(#[$doc:meta])* $name:ident, |$a:ident, $b:ident| $quarter:expr, |$x:ident, $y:ident, $s:ident, $c:ident| $general:expr) => {
        $(#[$doc])*
        #[inline(always)]
        fn $name<L: Lane, const N: usize>(&self, mut vectors: [Vector3<L>; N]) -> [Vector3<L>; N]
        where
            T: Param<L>,
            S: Param<L>,
        {
            let (i, k) = (Self::I, Self::K);
            match self.rotation {
                LinkTwist::Deg0 => {}
                LinkTwist::Deg90 => {
                    unroll!(n < N => {
                        let v = &mut vectors[n].0;
                        let ($a, $b) = (v[i], v[k]);
                        (v[i], v[k]) = $quarter;
                    });
                }
                LinkTwist::Deg180 => {
                    unroll!(n < N => {
                        let v = &mut vectors[n].0;
                        (v[i], v[k]) = (-v[i], -v[k]);
                    });
                }
                LinkTwist::General(s, c) => {
                    cold_path();
                    let ($s, $c): (L, L) = (s.get(), c.get());
                    unroll!(n < N => {
                        let v = &mut vectors[n].0;
                        let ($x, $y) = (v[i], v[k]);
                        (v[i], v[k]) = $general;
                    });
                }
            }
            vectors
        }
    };
}

impl<T: Copy, S: Copy, const ALONG: usize> Screw<T, S, ALONG> {
    /// Axes of the plane of rotation, in cyclic order.
    const I: usize = (ALONG + 1) % 3;
    const K: usize = (ALONG + 2) % 3;

    /// Rotates a vector from child to parent axes.
    #[inline(always)]
    pub fn rotate<L: Lane>(&self, v: Vector3<L>) -> Vector3<L>
    where
        T: Param<L>,
        S: Param<L>,
    {
        let [out] = self.rotate_all([v]);
        out
    }

    rotation!(
        /// Rotates vectors from child to parent axes, with one branch for all of them.
        rotate_all,
        |a, b| (-b, a),
        |a, b, s, c| (c.mul_add(a, -(s * b)), s.mul_add(a, c * b))
    );

    rotation!(
        /// Rotates vectors from parent to child axes, with one branch for all of them.
        rotate_all_inverse,
        |a, b| (b, -a),
        |a, b, s, c| (c.mul_add(a, s * b), c.mul_add(b, -(s * a)))
    );

    /// Transforms a point from the child frame to the parent frame.
    #[inline(always)]
    pub fn transform_point<L: Lane>(&self, mut point: Vector3<L>) -> Vector3<L>
    where
        T: Param<L>,
        S: Param<L>,
    {
        if let Some(d) = self.translation {
            let d: L = d.get();
            point.0[ALONG] += d;
        }
        self.rotate(point)
    }

    /// `Ad^-1 V`: transforms a twist from the parent frame to the child frame.
    #[inline(always)]
    pub fn adjoint_apply_inverse<L: Lane>(&self, twist: Vector6<L>) -> Vector6<L>
    where
        T: Param<L>,
        S: Param<L>,
    {
        let [linear, angular] = self.rotate_all_inverse([twist.linear, twist.angular]);
        self.translate_twist(Vector6 { linear, angular })
    }

    /// Rotates a vector and transforms a twist from the parent frame to the child frame.
    #[inline(always)]
    pub fn both_from_parent<L: Lane>(&self, v: Vector3<L>, twist: Vector6<L>) -> (Vector3<L>, Vector6<L>)
    where
        T: Param<L>,
        S: Param<L>,
    {
        let [v, linear, angular] = self.rotate_all_inverse([v, twist.linear, twist.angular]);
        (v, self.translate_twist(Vector6 { linear, angular }))
    }

    /// `v + omega x (translation along the axis)`
    #[inline(always)]
    fn translate_twist<L: Lane>(&self, mut twist: Vector6<L>) -> Vector6<L>
    where
        S: Param<L>,
    {
        let (i, k) = (Self::I, Self::K);
        if let Some(d) = self.translation {
            let (d, angular): (L, _) = (d.get(), twist.angular.0);
            let linear = &mut twist.linear.0;
            linear[i] = angular[k].mul_add(d, linear[i]);
            linear[k] = angular[i].neg_mul_add(d, linear[k]);
        }
        twist
    }

    /// `Ad^-T F`: transforms a wrench from the child frame to the parent frame.
    #[inline(always)]
    pub fn co_adjoint_apply_inverse<L: Lane>(&self, wrench: Vector6<L>) -> Vector6<L>
    where
        T: Param<L>,
        S: Param<L>,
    {
        let (i, k) = (Self::I, Self::K);
        let (f, mut m) = (wrench.linear, wrench.angular);
        if let Some(d) = self.translation {
            let d: L = d.get();
            // m + (translation along the axis) x f
            m.0[i] = f.0[k].neg_mul_add(d, m.0[i]);
            m.0[k] = f.0[i].mul_add(d, m.0[k]);
        }
        let [linear, angular] = self.rotate_all([f, m]);
        Vector6 { linear, angular }
    }

    /// `Ad^-T A Ad^-1`: transforms an inertia from the child frame to the parent frame.
    #[inline(always)]
    pub fn inertia_to_parent<L: Lane>(&self, inertia: &SpatialInertia<L>) -> SpatialInertia<L>
    where
        T: Param<L>,
        S: Param<L>,
    {
        self.transform_inertia::<L, false>(inertia)
    }

    /// [`Self::inertia_to_parent`] of an inertia whose row and column of the rotation about the axis are zero.
    #[inline(always)]
    pub fn revolute_inertia_to_parent<L: Lane>(&self, inertia: &SpatialInertia<L>) -> SpatialInertia<L>
    where
        T: Param<L>,
        S: Param<L>,
    {
        self.transform_inertia::<L, true>(inertia)
    }

    /// Translation along the axis, then rotation about it; `REVOLUTE` if the entries of the rotation about the axis are zero.
    /// (Each branch runs to the end: numbers that join after a branch would go through memory.)
    #[inline(always)]
    fn transform_inertia<L: Lane, const REVOLUTE: bool>(&self, a: &SpatialInertia<L>) -> SpatialInertia<L>
    where
        T: Param<L>,
        S: Param<L>,
    {
        match self.translation {
            Some(d) => self.rotate_inertia::<L, REVOLUTE>(&Self::translate_inertia::<L, REVOLUTE>(a, d.get())),
            None => self.rotate_inertia::<L, REVOLUTE>(a),
        }
    }

    /// `H' = H - M [r]`, `J' = J - H^T [r] + [r] H'`
    #[inline(always)]
    fn translate_inertia<L: Lane, const REVOLUTE: bool>(a: &SpatialInertia<L>, d: L) -> SpatialInertia<L> {
        let h = Self::translate_coupling(&a.m, &a.h, d);
        let j = Self::translate_angular::<L, REVOLUTE>(&a.j, &Self::sums(&a.h, &h), d);
        SpatialInertia { m: a.m, h, j }
    }

    /// `H' = H - M [r]`
    #[inline(always)]
    pub(super) fn translate_coupling<L: Lane>(m: &[L; 6], old: &[[L; 3]; 3], d: L) -> [[L; 3]; 3] {
        let (i, k, n) = (Self::I, Self::K, ALONG);
        let mut h = *old;
        let (ii, ik, kk, inn, kn) = (PACKED[i][i], PACKED[i][k], PACKED[k][k], PACKED[i][n], PACKED[k][n]);
        h[i][i] = m[ik].neg_mul_add(d, h[i][i]);
        h[i][k] = m[ii].mul_add(d, h[i][k]);
        h[k][i] = m[kk].neg_mul_add(d, h[k][i]);
        h[k][k] = m[ik].mul_add(d, h[k][k]);
        h[n][i] = m[kn].neg_mul_add(d, h[n][i]);
        h[n][k] = m[inn].mul_add(d, h[n][k]);
        h
    }

    /// Sums over the coupling blocks H before and after a translation that enter the angular block.
    #[inline(always)]
    pub(super) fn sums<L: Lane>(old: &[[L; 3]; 3], h: &[[L; 3]; 3]) -> [L; 5] {
        let (i, k, n) = (Self::I, Self::K, ALONG);
        [old[k][i] + h[k][i], old[i][i] - h[k][k], old[i][k] + h[i][k], h[k][n], h[i][n]]
    }

    /// `J' = J - H^T [r] + [r] H'` by these [`Self::sums`].
    #[inline(always)]
    pub(super) fn translate_angular<L: Lane, const REVOLUTE: bool>(old: &[L; 6], sums: &[L; 5], d: L) -> [L; 6] {
        let (i, k, n) = (Self::I, Self::K, ALONG);
        let (ii, ik, kk, inn, kn) = (PACKED[i][i], PACKED[i][k], PACKED[k][k], PACKED[i][n], PACKED[k][n]);
        let mut j = *old;
        j[ii] = sums[0].neg_mul_add(d, j[ii]);
        j[ik] = sums[1].mul_add(d, j[ik]);
        j[kk] = sums[2].mul_add(d, j[kk]);
        if !REVOLUTE {
            j[inn] = sums[3].neg_mul_add(d, j[inn]);
            j[kn] = sums[4].mul_add(d, j[kn]);
        }
        j
    }

    #[inline(always)]
    fn rotate_inertia<L: Lane, const REVOLUTE: bool>(&self, a: &SpatialInertia<L>) -> SpatialInertia<L>
    where
        T: Param<L>,
        S: Param<L>,
    {
        SpatialInertia {
            m: self.rotate_symmetric::<L, false>(&a.m),
            h: self.rotate_full::<L, REVOLUTE>(&a.h),
            j: self.rotate_symmetric::<L, REVOLUTE>(&a.j),
        }
    }

    /// `R S R^T` of a symmetric matrix; `PLANAR` if its entries along the axis are zero.
    #[inline(always)]
    pub(super) fn rotate_symmetric<L: Lane, const PLANAR: bool>(&self, s: &[L; 6]) -> [L; 6]
    where
        T: Param<L>,
        S: Param<L>,
    {
        let (i, k, n) = (Self::I, Self::K, ALONG);
        let (ii, ik, kk, inn, kn) = (PACKED[i][i], PACKED[i][k], PACKED[k][k], PACKED[i][n], PACKED[k][n]);
        let mut out = *s;
        match self.rotation {
            LinkTwist::Deg0 => {}
            LinkTwist::Deg90 => {
                out[ii] = s[kk];
                out[kk] = s[ii];
                out[ik] = -s[ik];
                out[inn] = -s[kn];
                out[kn] = s[inn];
            }
            LinkTwist::Deg180 => {
                out[inn] = -s[inn];
                out[kn] = -s[kn];
            }
            LinkTwist::General(sin, cos) => {
                cold_path();
                let (sin, cos): (L, L) = (sin.get(), cos.get());
                let difference = s[ii] - s[kk];
                // With t = sin (difference) + 2 cos S_ik: S_kk' = S_kk + sin t, S_ii' = S_ii - sin t.
                let t = sin.mul_add(difference, (cos + cos) * s[ik]);
                out[ii] = sin.neg_mul_add(t, s[ii]);
                out[kk] = sin.mul_add(t, s[kk]);
                out[ik] = cos.mul_add(t, -s[ik]);
                if !PLANAR {
                    out[inn] = cos.mul_add(s[inn], -(sin * s[kn]));
                    out[kn] = sin.mul_add(s[inn], cos * s[kn]);
                }
            }
        }
        out
    }

    /// `R H R^T` of a full matrix; `PLANAR` if its column along the axis is zero.
    #[inline(always)]
    pub(super) fn rotate_full<L: Lane, const PLANAR: bool>(&self, h: &[[L; 3]; 3]) -> [[L; 3]; 3]
    where
        T: Param<L>,
        S: Param<L>,
    {
        let (i, k, n) = (Self::I, Self::K, ALONG);
        let mut out = *h;
        match self.rotation {
            LinkTwist::Deg0 => {}
            LinkTwist::Deg90 => {
                (out[i][i], out[i][k], out[k][i], out[k][k]) = (h[k][k], -h[k][i], -h[i][k], h[i][i]);
                (out[n][i], out[n][k]) = (-h[n][k], h[n][i]);
                if !PLANAR {
                    (out[i][n], out[k][n]) = (-h[k][n], h[i][n]);
                }
            }
            LinkTwist::Deg180 => {
                (out[n][i], out[n][k]) = (-h[n][i], -h[n][k]);
                if !PLANAR {
                    (out[i][n], out[k][n]) = (-h[i][n], -h[k][n]);
                }
            }
            LinkTwist::General(sin, cos) => {
                cold_path();
                let (sin, cos): (L, L) = (sin.get(), cos.get());
                // As for a symmetric matrix; the skew part is invariant.
                let t = sin.mul_add(h[i][i] - h[k][k], cos * (h[i][k] + h[k][i]));
                out[i][i] = sin.neg_mul_add(t, h[i][i]);
                out[k][k] = sin.mul_add(t, h[k][k]);
                out[i][k] = cos.mul_add(t, -h[k][i]);
                out[k][i] = cos.mul_add(t, -h[i][k]);
                out[n][i] = cos.mul_add(h[n][i], -(sin * h[n][k]));
                out[n][k] = sin.mul_add(h[n][i], cos * h[n][k]);
                if !PLANAR {
                    out[i][n] = cos.mul_add(h[i][n], -(sin * h[k][n]));
                    out[k][n] = sin.mul_add(h[i][n], cos * h[k][n]);
                }
            }
        }
        out
    }
}

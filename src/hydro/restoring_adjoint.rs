//! Adjoint of weight and buoyancy.

use super::restoring::Restoring;
use crate::lane::Lane;
use crate::lie::{Vector3, Vector6};

/// Derivatives of `a . K(g) b` of a stiffness: see [`Restoring::stiffness`].
pub struct StiffnessCotangents<L> {
    /// By gravity.
    pub of_gravity: Vector3<L>,
    /// By the moment.
    pub of_moment: Vector3<L>,
}

impl<L: Lane> Restoring<L> {
    /// Derivative by gravity of the product of a dual twist with the wrench.
    #[inline(always)]
    pub fn wrench_adjoint(&self, dual: Vector6<L>) -> Vector3<L> {
        dual.angular.cross_add(Vector3(self.moment), dual.linear.scale(self.net_mass))
    }

    /// Derivatives of `a . K(g) b`, with `K = k (I - e e^T)`, `k = (|s| |g| + s . g) / 2`, `e = g / |g|`.
    #[inline(always)]
    pub fn stiffness_adjoint(&self, g: Vector3<L>, a: Vector3<L>, b: Vector3<L>) -> StiffnessCotangents<L> {
        let (s, half, zero) = (Vector3(self.moment), L::c(0.5), L::zero());
        let square = g.dot(g).max(L::c(f64::from(f32::MIN_POSITIVE)));
        let (size, moment) = (square.sqrt(), s.dot(s).sqrt());
        let e = g.scale(L::c(1.0) / size);
        let (along_a, along_b) = (e.dot(a), e.dot(b));
        let k = moment.mul_add(size, s.dot(g)) * half;
        let of_k = along_a.neg_mul_add(along_b, a.dot(b)) * half;
        let of_e = a.scale_add(along_b, b.scale(along_a)).scale(k / size);
        let across = of_e - e.scale(e.dot(of_e));
        let ratio = L::select(zero.lt(moment), size / moment, zero);
        StiffnessCotangents {
            of_gravity: e.scale_add(moment, s).scale(of_k) - across,
            of_moment: s.scale_add(ratio, g).scale(of_k),
        }
    }
}

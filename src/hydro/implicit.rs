//! Damping and stiffness matrices of damping and restoring forces for the linearly implicit method; upper bounds where the force
//! has no simple matrix. All are positive semi-definite, so that the sum with an inertia stays invertible.
//!
//! They are secants rather than tangents: quadratic damping `-D_Q |v| v` has the secant `D_Q |v|`, with which one implicit
//! Euler step is exact for a single velocity and never changes its sign.

use super::damping::{CoefficientFrame, CoefficientMatrix, Damping};
use super::restoring::Restoring;
use crate::lane::{Lane, Param, get_all, unroll};
use crate::lie::{Pose, Vector3, Vector6};
use crate::spatial::SpatialInertia;

impl<P: Copy> Damping<P> {
    /// Symmetric D of `damping = -D V` at the relative twist `twist`, both in the body frame. Full coefficients enter by bounds:
    /// [`Self::linear_bound`], and half the sums of rows and columns of the quadratic ones.
    #[inline(always)]
    pub fn damping_matrix<L: Lane>(&self, twist: Vector6<L>) -> SpatialInertia<L>
    where
        P: Param<L>,
    {
        let matrix = self.damping_matrix_in_frame(self.frame.twist_from_body(twist));
        match &self.frame {
            CoefficientFrame::Body => matrix,
            CoefficientFrame::Shifted(p) => matrix.shifted(Vector3(get_all(p))),
            CoefficientFrame::General(r, p) => matrix.to_parent(&Pose::of(r, p)),
        }
    }

    #[inline(always)]
    fn damping_matrix_in_frame<L: Lane>(&self, twist: Vector6<L>) -> SpatialInertia<L>
    where
        P: Param<L>,
    {
        let mut sum = SpatialInertia::zero();
        let mut diagonal = [L::zero(); 6];
        match (&self.linear, &self.linear_bound) {
            (CoefficientMatrix::Diagonal(d), _) => diagonal = get_all(d),
            (CoefficientMatrix::Full(_), Some(bound)) => sum = bound.get(),
            _ => {}
        }
        self.quadratic.add_quadratic_diagonal(&twist.to_array(), &mut diagonal);
        unroll!(i in 0 1 2 3 4 5 => {
            sum.add_diagonal(i, diagonal[i]);
        });
        sum
    }
}

impl<P: Copy> Restoring<P> {
    /// Symmetric K of the moment `-K delta` that opposes a rotation by delta: `K = k (I - e e^T)` with e along gravity `g` (body
    /// axes) and `k = (|s| |g| + s . g) / 2`. Exact at the stable equilibrium, 0 at the unstable one.
    #[inline(always)]
    pub fn stiffness<L: Lane>(&self, g: Vector3<L>) -> [L; 6]
    where
        P: Param<L>,
    {
        let s: Vector3<L> = Vector3(get_all(&self.moment));
        let square = g.dot(g).max(L::c(f64::from(f32::MIN_POSITIVE)));
        let k = ((s.dot(s) * square).sqrt() + s.dot(g)) * L::c(0.5);
        let e = g.scale(L::c(1.0) / square.sqrt()).0;
        let mut stiffness = [L::zero(); 6];
        unroll!(place in 0 1 2 3 4 5 => {
            let (i, j) = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)][place];
            let unit = if i == j { k } else { L::zero() };
            stiffness[place] = (e[i] * e[j]).neg_mul_add(k, unit);
        });
        stiffness
    }
}

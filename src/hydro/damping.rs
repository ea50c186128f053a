//! Linear and quadratic damping.

use crate::lane::{Lane, Param, get_all, numbers, unroll};
use crate::lie::{Pose, Vector3, Vector6};
use crate::spatial::SpatialInertia;

numbers! {
    /// A 6x6 matrix of damping coefficients.
    #[derive(Debug, Clone, PartialEq)]
    pub enum CoefficientMatrix<P> {
        /// All zero.
        None,
        /// Diagonal.
        Diagonal(diagonal: [P; 6]),
        /// Full, by rows.
        Full(rows: Box<[[P; 6]; 6]>),
    }
}

impl<P: Copy> CoefficientMatrix<P> {
    /// `sum - D x`
    #[inline(always)]
    fn subtract<L: Lane>(&self, x: &[L; 6], sum: &mut [L; 6])
    where
        P: Param<L>,
    {
        match self {
            CoefficientMatrix::None => {}
            CoefficientMatrix::Diagonal(d) => {
                unroll!(i in 0 1 2 3 4 5 => {
                    sum[i] = d[i].get().neg_mul_add(x[i], sum[i]);
                });
            }
            CoefficientMatrix::Full(rows) => {
                unroll!(i in 0 1 2 3 4 5 => {
                    unroll!(k in 0 1 2 3 4 5 => {
                        sum[i] = rows[i][k].get().neg_mul_add(x[k], sum[i]);
                    });
                });
            }
        }
    }

    /// Adds the diagonal of the matrix of quadratic damping at a twist: see [`Damping::damping_matrix`].
    #[inline(always)]
    pub(super) fn add_quadratic_diagonal<L: Lane>(&self, v: &[L; 6], diagonal: &mut [L; 6])
    where
        P: Param<L>,
    {
        match self {
            CoefficientMatrix::None => {}
            CoefficientMatrix::Diagonal(d) => {
                unroll!(i in 0 1 2 3 4 5 => {
                    diagonal[i] = d[i].get().mul_add(v[i].abs(), diagonal[i]);
                });
            }
            CoefficientMatrix::Full(rows) => {
                unroll!(i in 0 1 2 3 4 5 => {
                    unroll!(k in 0 1 2 3 4 5 => {
                        let (row, column) = ((rows[i][k].get() * v[k]).abs(), (rows[k][i].get() * v[i]).abs());
                        diagonal[i] = (row + column).mul_add(L::c(0.5), diagonal[i]);
                    });
                });
            }
        }
    }
}

numbers! {
    /// Frame of the coefficients, relative to the body frame.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub enum CoefficientFrame<P> {
        /// The body frame.
        Body,
        /// Parallel axes, with the origin at this point, m.
        Shifted(point: [P; 3]),
        /// General pose: rotation by rows, position, m.
        General(rows: [[P; 3]; 3], point: [P; 3]),
    }
}

impl<P: Copy> CoefficientFrame<P> {
    /// Twist in this frame of a twist in the body frame.
    #[inline(always)]
    pub(super) fn twist_from_body<L: Lane>(&self, twist: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        match self {
            CoefficientFrame::Body => twist,
            CoefficientFrame::Shifted(p) => {
                Vector6 { linear: twist.angular.cross_add(Vector3(get_all(p)), twist.linear), ..twist }
            }
            CoefficientFrame::General(r, p) => Pose::of(r, p).adjoint_apply_inverse(twist),
        }
    }

    /// Wrench in the body frame of a wrench in this frame.
    #[inline(always)]
    pub(super) fn wrench_to_body<L: Lane>(&self, wrench: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        match self {
            CoefficientFrame::Body => wrench,
            CoefficientFrame::Shifted(p) => {
                Vector6 { angular: Vector3(get_all(p)).cross_add(wrench.linear, wrench.angular), ..wrench }
            }
            CoefficientFrame::General(r, p) => Pose::of(r, p).co_adjoint_apply_inverse(wrench),
        }
    }
}

numbers! {
    /// Damping `F = -(D_L V + D_Q (V * |V|))` of the twist V relative to the water, evaluated in the frame of the coefficients: the
    /// quadratic part is not covariant, so it is never transformed to another frame. `[HC eq. 22]`
    #[derive(Debug, Clone, PartialEq)]
    pub struct Damping<P> {
        /// Frame of the coefficients.
        pub frame: CoefficientFrame<P> = unvisited,
        /// D_L.
        pub linear: CoefficientMatrix<P>,
        /// D_Q.
        pub quadratic: CoefficientMatrix<P>,
        /// Symmetric bound `S + N^T S^-1 N` of a full D_L with symmetric part S and skew part N (lift), for the linearly implicit
        /// method, in which lift itself would be an unsymmetric matrix.
        pub linear_bound: Option<SpatialInertia<P>>,
    }
}

impl<P: Copy> Damping<P> {
    /// Damping wrench at the relative twist `twist`, both in the body frame.
    #[inline(always)]
    pub fn wrench<L: Lane>(&self, twist: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        self.frame.wrench_to_body(self.in_frame(self.frame.twist_from_body(twist)))
    }

    #[inline(always)]
    fn in_frame<L: Lane>(&self, twist: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let v = twist.to_array();
        let mut wrench = [L::zero(); 6];
        self.linear.subtract(&v, &mut wrench);
        if !matches!(self.quadratic, CoefficientMatrix::None) {
            let mut squares = v;
            unroll!(k in 0 1 2 3 4 5 => {
                squares[k] = v[k] * v[k].abs();
            });
            self.quadratic.subtract(&squares, &mut wrench);
        }
        Vector6::from_array(wrench)
    }
}

//! Linear and quadratic drag.

use crate::lane::{Lane, Param, get_all};
use crate::lie::{Pose, Vector3, Vector6};
use crate::spatial::SpatialInertia;

/// A 6x6 coefficient matrix, as sparse as the scene has it.
#[derive(Debug, Clone, PartialEq)]
pub enum CoefficientMatrix<P> {
    /// All zero.
    None,
    /// A diagonal.
    Diagonal([P; 6]),
    /// All 36, by rows.
    Full(Box<[[P; 6]; 6]>),
}

impl<P: Copy> CoefficientMatrix<P> {
    /// The same with each number changed.
    pub fn map<Q>(&self, change: impl Fn(P) -> Q) -> CoefficientMatrix<Q> {
        match self {
            CoefficientMatrix::None => CoefficientMatrix::None,
            CoefficientMatrix::Diagonal(d) => CoefficientMatrix::Diagonal(d.map(change)),
            CoefficientMatrix::Full(rows) => CoefficientMatrix::Full(Box::new(rows.map(|row| row.map(&change)))),
        }
    }

    /// `sum - D x`
    #[inline(always)]
    fn subtract<L: Lane>(&self, x: &[L; 6], sum: &mut [L; 6])
    where
        P: Param<L>,
    {
        match self {
            CoefficientMatrix::None => {}
            CoefficientMatrix::Diagonal(d) => {
                for i in 0..6 {
                    sum[i] = d[i].get().neg_mul_add(x[i], sum[i]);
                }
            }
            CoefficientMatrix::Full(rows) => {
                for i in 0..6 {
                    for k in 0..6 {
                        sum[i] = rows[i][k].get().neg_mul_add(x[k], sum[i]);
                    }
                }
            }
        }
    }
}

/// Where the coefficients' frame lies on the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CoefficientFrame<P> {
    /// The coefficients' frame is the body's.
    Body,
    /// Parallel to the body frame, at this point.
    Shifted([P; 3]),
    /// At a pose in the body frame: rotation by rows, position.
    General([[P; 3]; 3], [P; 3]),
}

impl<P: Copy> CoefficientFrame<P> {
    /// The same with each number changed.
    pub fn map<Q>(&self, change: impl Fn(P) -> Q) -> CoefficientFrame<Q> {
        match self {
            CoefficientFrame::Body => CoefficientFrame::Body,
            CoefficientFrame::Shifted(p) => CoefficientFrame::Shifted(p.map(&change)),
            CoefficientFrame::General(r, p) => CoefficientFrame::General(r.map(|row| row.map(&change)), p.map(&change)),
        }
    }
}

/// Drag `F = -(D_L V + D_Q (V * |V|))` of the twist V relative to the water, in the frame of the coefficients: the
/// quadratic part is not covariant, so it is never moved to another frame. `[HC eq. 22]`
#[derive(Debug, Clone, PartialEq)]
pub struct Damping<P> {
    /// The frame of the coefficients.
    pub frame: CoefficientFrame<P>,
    /// D_L.
    pub linear: CoefficientMatrix<P>,
    /// D_Q.
    pub quadratic: CoefficientMatrix<P>,
    /// Symmetric bound of a full D_L, with its symmetric part S and its skew part N (lift): `S + N^T S^-1 N`. For
    /// linearly implicit methods, to which lift itself would be an unsymmetric matrix.
    pub linear_bound: Option<SpatialInertia<P>>,
}

impl<P: Copy> Damping<P> {
    /// The same with each number changed.
    pub fn map<Q>(&self, change: impl Fn(P) -> Q) -> Damping<Q> {
        Damping {
            frame: self.frame.map(&change),
            linear: self.linear.map(&change),
            quadratic: self.quadratic.map(&change),
            linear_bound: self.linear_bound.map(|bound| bound.map(&change)),
        }
    }

    /// Drag on a body of relative twist `twist`, both in body frame.
    #[inline(always)]
    pub fn wrench<L: Lane>(&self, twist: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        match &self.frame {
            CoefficientFrame::Body => self.in_place(twist),
            CoefficientFrame::Shifted(p) => {
                let r = Vector3(get_all(p));
                let there = Vector6 { linear: twist.angular.cross_add(r, twist.linear), ..twist };
                let wrench = self.in_place(there);
                Vector6 { angular: r.cross_add(wrench.linear, wrench.angular), ..wrench }
            }
            CoefficientFrame::General(r, p) => {
                let pose = Pose::of(r, p);
                pose.co_adjoint_apply_inverse(self.in_place(pose.adjoint_apply_inverse(twist)))
            }
        }
    }

    #[inline(always)]
    fn in_place<L: Lane>(&self, twist: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let v = twist.to_array();
        let mut wrench = [L::zero(); 6];
        self.linear.subtract(&v, &mut wrench);
        if !matches!(self.quadratic, CoefficientMatrix::None) {
            let mut squares = v;
            for x in &mut squares {
                *x = *x * x.abs();
            }
            self.quadratic.subtract(&squares, &mut wrench);
        }
        Vector6::from_array(wrench)
    }
}

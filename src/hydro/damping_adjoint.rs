//! Adjoint of damping: its wrench, products of it with a dual twist, and their derivatives by the twist.
//!
//! With the dual twist lambda, `lambda . (D_L V + D_Q V |V|)` and, for linearly implicit methods, `lambda . h D A` with the matrix D
//! of [`Damping::damping_matrix`], which depends on V, and the acceleration A.

use super::damping::{CoefficientMatrix, Damping};
use crate::lane::{Lane, unroll};
use crate::lie::Vector6;
use crate::spatial::SpatialInertia;

/// Twists of a body, or their counterparts in the frame of the coefficients.
#[derive(Clone, Copy)]
pub struct DampedMotion<L> {
    /// Twist V relative to the water.
    pub twist: Vector6<L>,
    /// Step size h times the acceleration A, of linearly implicit methods alone.
    pub change: Vector6<L>,
    /// Dual twist lambda.
    pub dual: Vector6<L>,
}

/// Sums of the terms of a body.
#[derive(Clone, Copy)]
pub struct DampedSums<L> {
    /// Force.
    pub force: Vector6<L>,
    /// Derivative by V.
    pub of_twist: Vector6<L>,
    /// Derivative by the change `h A`.
    pub of_change: Vector6<L>,
}

impl<L: Lane> CoefficientMatrix<L> {
    /// `sum + D x`
    #[inline(always)]
    fn add(&self, x: &[L; 6], sum: &mut [L; 6]) {
        match self {
            CoefficientMatrix::None => {}
            CoefficientMatrix::Diagonal(d) => {
                unroll!(i in 0 1 2 3 4 5 => {
                    sum[i] = d[i].mul_add(x[i], sum[i]);
                });
            }
            CoefficientMatrix::Full(rows) => {
                for i in 0..6 {
                    for k in 0..6 {
                        sum[i] = rows[i][k].mul_add(x[k], sum[i]);
                    }
                }
            }
        }
    }

    /// `sum + D^T x`
    #[inline(always)]
    fn add_transposed(&self, x: &[L; 6], sum: &mut [L; 6]) {
        match self {
            CoefficientMatrix::Full(rows) => {
                for i in 0..6 {
                    for k in 0..6 {
                        sum[k] = rows[i][k].mul_add(x[i], sum[k]);
                    }
                }
            }
            _ => self.add(x, sum),
        }
    }

    /// Diagonal of the matrix of quadratic damping at a twist.
    #[inline(always)]
    fn quadratic_diagonal(&self, v: &[L; 6]) -> [L; 6] {
        let mut diagonal = [L::zero(); 6];
        self.add_quadratic_diagonal(v, &mut diagonal);
        diagonal
    }

    /// Derivatives by the twist from the derivatives by this diagonal.
    #[inline(always)]
    fn quadratic_diagonal_adjoint(&self, v: &[L; 6], of: &[L; 6], sum: &mut [L; 6]) {
        match self {
            CoefficientMatrix::None => {}
            CoefficientMatrix::Diagonal(d) => {
                unroll!(i in 0 1 2 3 4 5 => {
                    sum[i] = (d[i] * sign(v[i])).mul_add(of[i], sum[i]);
                });
            }
            CoefficientMatrix::Full(rows) => {
                for i in 0..6 {
                    let half = of[i] * L::c(0.5);
                    for k in 0..6 {
                        sum[k] = (rows[i][k].abs() * sign(v[k])).mul_add(half, sum[k]);
                        sum[i] = (rows[k][i].abs() * sign(v[i])).mul_add(half, sum[i]);
                    }
                }
            }
        }
    }
}

/// Slope of the magnitude: 0 at 0.
#[inline(always)]
fn sign<L: Lane>(x: L) -> L {
    let zero = L::zero();
    L::select(zero.lt(x), L::c(1.0), L::select(x.lt(zero), L::c(-1.0), zero))
}

/// Matrix of linear damping in linearly implicit methods times a vector.
#[inline(always)]
fn linear_bound<L: Lane>(linear: &CoefficientMatrix<L>, bound: &Option<SpatialInertia<L>>, x: Vector6<L>) -> [L; 6] {
    match (linear, bound) {
        (CoefficientMatrix::Full(_), Some(bound)) => bound.apply(x).to_array(),
        (CoefficientMatrix::Diagonal(_), _) => {
            let mut product = [L::zero(); 6];
            linear.add(&x.to_array(), &mut product);
            product
        }
        _ => [L::zero(); 6],
    }
}

#[inline(always)]
fn plus<L: Lane>(sum: &mut [L; 6], x: &[L; 6]) {
    unroll!(i in 0 1 2 3 4 5 => {
        sum[i] += x[i];
    });
}

#[inline(always)]
fn times<L: Lane>(a: &[L; 6], b: &[L; 6]) -> [L; 6] {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3], a[4] * b[4], a[5] * b[5]]
}

impl<L: Lane> Damping<L> {
    #[inline(always)]
    fn in_frame_motion(&self, at: &DampedMotion<L>) -> DampedMotion<L> {
        DampedMotion {
            twist: self.frame.twist_from_body(at.twist),
            change: self.frame.twist_from_body(at.change),
            dual: self.frame.twist_from_body(at.dual),
        }
    }

    /// Adds the force that overcomes this damping and its products; the matrix's where `IMPLICIT` holds.
    #[inline(always)]
    pub fn add_adjoint<const IMPLICIT: bool>(&self, at: &DampedMotion<L>, sums: &mut DampedSums<L>) {
        let there = self.in_frame_motion(at);
        let (v, dual) = (there.twist.to_array(), there.dual.to_array());
        let (mut force, mut of_twist) = ([L::zero(); 6], [L::zero(); 6]);
        self.linear.add(&v, &mut force);
        self.linear.add_transposed(&dual, &mut of_twist);
        if !matches!(self.quadratic, CoefficientMatrix::None) {
            let size = [v[0].abs(), v[1].abs(), v[2].abs(), v[3].abs(), v[4].abs(), v[5].abs()];
            self.quadratic.add(&times(&v, &size), &mut force);
            let mut slope = [L::zero(); 6];
            self.quadratic.add_transposed(&dual, &mut slope);
            unroll!(i in 0 1 2 3 4 5 => {
                of_twist[i] = (size[i] + size[i]).mul_add(slope[i], of_twist[i]);
            });
        }
        if IMPLICIT {
            let change = there.change.to_array();
            let diagonal = self.quadratic.quadratic_diagonal(&v);
            plus(&mut force, &linear_bound(&self.linear, &self.linear_bound, there.change));
            plus(&mut force, &times(&diagonal, &change));
            let mut of_change = linear_bound(&self.linear, &self.linear_bound, there.dual);
            plus(&mut of_change, &times(&diagonal, &dual));
            sums.of_change = sums.of_change + self.frame.wrench_to_body(Vector6::from_array(of_change));
            self.quadratic.quadratic_diagonal_adjoint(&v, &times(&dual, &change), &mut of_twist);
        }
        sums.force = sums.force + self.frame.wrench_to_body(Vector6::from_array(force));
        sums.of_twist = sums.of_twist + self.frame.wrench_to_body(Vector6::from_array(of_twist));
    }

    /// Products of the dual twist with the forces of unscaled coefficients: derivatives by the factors on linear and quadratic
    /// damping. Both have the same frame.
    #[inline(always)]
    pub fn products<const IMPLICIT: bool>(&self, unscaled: &Self, at: &DampedMotion<L>) -> [L; 2] {
        let there = self.in_frame_motion(at);
        let v = there.twist.to_array();
        let (mut linear, mut quadratic) = ([L::zero(); 6], [L::zero(); 6]);
        unscaled.linear.add(&v, &mut linear);
        let size = [v[0].abs(), v[1].abs(), v[2].abs(), v[3].abs(), v[4].abs(), v[5].abs()];
        unscaled.quadratic.add(&times(&v, &size), &mut quadratic);
        if IMPLICIT {
            plus(&mut linear, &linear_bound(&unscaled.linear, &unscaled.linear_bound, there.change));
            plus(&mut quadratic, &times(&unscaled.quadratic.quadratic_diagonal(&v), &there.change.to_array()));
        }
        [there.dual.dot(Vector6::from_array(linear)), there.dual.dot(Vector6::from_array(quadratic))]
    }
}

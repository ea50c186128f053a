//! Compilation of damping coefficients.

use nalgebra as na;

use crate::description::Body;
use crate::hydro::{CoefficientFrame, CoefficientMatrix, Damping};
use crate::lie::{Matrix3, Pose};
use crate::spatial::SpatialInertia;

/// Damping of a body, if any coefficient differs from 0.
pub(super) fn damping(body: &Body, hydrodynamic: &Pose<f64>) -> Option<Damping<f64>> {
    let coefficients = |m: &na::Matrix6<f64>| {
        if m.iter().all(|&x| x == 0.0) {
            CoefficientMatrix::None
        } else if *m == na::Matrix6::from_diagonal(&m.diagonal()) {
            CoefficientMatrix::Diagonal(m.diagonal().into())
        } else {
            CoefficientMatrix::Full(Box::new([0, 1, 2, 3, 4, 5].map(|i| [0, 1, 2, 3, 4, 5].map(|k| m[(i, k)]))))
        }
    };
    let (linear, quadratic) = (coefficients(&body.damping.linear), coefficients(&body.damping.quadratic));
    if (&linear, &quadratic) == (&CoefficientMatrix::None, &CoefficientMatrix::None) {
        return None;
    }
    Some(damping_at(linear, quadratic, hydrodynamic))
}

/// Damping with coefficients in the frame at `at`. Where its axes lie along the body's, the coefficients are permuted instead
/// of rotating the twist: `v |v|` is odd, so the quadratic part allows this as well.
pub(super) fn damping_at(
    linear: CoefficientMatrix<f64>,
    quadratic: CoefficientMatrix<f64>,
    at: &Pose<f64>,
) -> Damping<f64> {
    let Some((axes, [sin, cos])) = z_aligned(&at.rotation) else {
        let linear_bound = linear_bound(&linear);
        let frame = CoefficientFrame::General(at.rotation.0, at.position.0);
        return Damping { frame, linear, quadratic, linear_bound };
    };
    let frame = if sin != 0.0 {
        CoefficientFrame::General([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]], at.position.0)
    } else if at.position.0 != [0.0; 3] {
        CoefficientFrame::Shifted(at.position.0)
    } else {
        CoefficientFrame::Body
    };
    let (linear, quadratic) = (permuted(&linear, &axes), permuted(&quadratic, &axes));
    let linear_bound = linear_bound(&linear);
    Damping { frame, linear, quadratic, linear_bound }
}

/// Maximum ratio of lift to the damping of the same motion that is bounded in full: a bound for more would slow down
/// motions that are not stiff.
const MAX_LIFT: f64 = 30.0;

/// `S + N^T S^-1 N` of a full D_L: see [`Damping::linear_bound`].
fn linear_bound(linear: &CoefficientMatrix<f64>) -> Option<SpatialInertia<f64>> {
    let CoefficientMatrix::Full(rows) = linear else { return None };
    let d = na::Matrix6::from_fn(|i, k| rows[i][k]);
    let (s, n) = ((d + d.transpose()) / 2.0, (d - d.transpose()) / 2.0);
    let bound = |s: na::Matrix6<f64>| {
        let factor = s.cholesky()?;
        let half = factor.l().solve_lower_triangular(&n)?;
        let ratio = factor.l().solve_lower_triangular(&half.transpose())?.norm();
        (ratio <= MAX_LIFT).then(|| half.tr_mul(&half))
    };
    // Where lift comes with too little damping, S is increased in proportion to the lift of each axis.
    let minimum = na::Matrix6::from_fn(|i, k| if i == k { n.row(i).abs().sum() / MAX_LIFT } else { 0.0 });
    let bound = s + bound(s).or_else(|| bound(s + 2.0 * minimum)).unwrap_or_else(na::Matrix6::zeros);
    Some(SpatialInertia::from_entries(|i, k| bound[(i, k)]))
}

/// Signed permutation: for each axis of one frame, the parallel axis of another and its sign.
type Axes = [(usize, f64); 3];

/// Decomposition of a rotation into a signed permutation of axes and a rotation about z, given by its sine and cosine; none
/// unless one of the axes is parallel to z.
fn z_aligned(rotation: &Matrix3<f64>) -> Option<(Axes, [f64; 2])> {
    let rows = &rotation.0;
    let along = |row: usize| (0..3).max_by(|&i, &k| rows[row][i].abs().total_cmp(&rows[row][k].abs()));
    let (x, z) = (along(0)?, along(2)?);
    if (0..3).any(|k| k != z && rows[2][k].abs() > 1e-14) {
        return None;
    }
    let y = 3 - x - z;
    let axes = [(x, rows[0][x].signum()), (y, rows[1][y].signum()), (z, rows[2][z].signum())];
    let [sin, cos] = [rows[1][x], rows[0][x]].map(|entry| entry * axes[0].1);
    Some((axes, if sin.abs() > 1e-14 { [sin, cos] } else { [0.0, 1.0] }))
}

/// Coefficients after a signed permutation of the axes.
fn permuted(coefficients: &CoefficientMatrix<f64>, axes: &Axes) -> CoefficientMatrix<f64> {
    let of = |i: usize| (axes[i % 3].0 + i / 3 * 3, axes[i % 3].1);
    let six = [0, 1, 2, 3, 4, 5];
    match coefficients {
        CoefficientMatrix::None => CoefficientMatrix::None,
        CoefficientMatrix::Diagonal(d) => CoefficientMatrix::Diagonal(six.map(|i| d[of(i).0])),
        CoefficientMatrix::Full(rows) => {
            let entry = |i: usize, k: usize| of(i).1 * of(k).1 * rows[of(i).0][of(k).0];
            CoefficientMatrix::Full(Box::new(six.map(|i| six.map(|k| entry(i, k)))))
        }
    }
}

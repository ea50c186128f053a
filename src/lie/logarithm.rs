//! Logarithm of SO(3): rotation vectors.

use super::{Matrix3, Vector3};
use crate::lane::{Lane, atan2, unroll};

/// Rotation vector `log R`, of length at most pi, with its derivative at the identity too. `[MLS94 eq. 2.17]`
///
/// By the quaternion, largest entry first: accurate near 0 and near pi, where the trace and the skew part lose digits.
#[inline(always)]
pub fn rotation_vector<L: Lane>(rotation: &Matrix3<L>) -> Vector3<L> {
    rotation_vector_and_angle(rotation).0
}

/// [`rotation_vector`] and its length.
#[inline(always)]
pub fn rotation_vector_and_angle<L: Lane>(rotation: &Matrix3<L>) -> (Vector3<L>, L) {
    let (w, v) = quaternion_ray(rotation);
    let length = v.dot(v).sqrt();
    let minimum = if <L::Real as crate::lane::Real>::SINGLE { f64::from(f32::MIN_POSITIVE) } else { f64::MIN_POSITIVE };
    let half = atan2(length, w.abs());
    let angle = half + half;
    // The limit of the quotient where the squares of the entries underflow.
    let factor = L::select(length.lt(L::c(minimum)), L::c(2.0) / w.abs(), angle / length.max(L::c(minimum)));
    (v.scale(L::select(w.lt(L::zero()), -factor, factor)), angle)
}

/// Length of [`rotation_vector`].
#[inline(always)]
pub fn rotation_angle<L: Lane>(rotation: &Matrix3<L>) -> L {
    let (w, v) = quaternion_ray(rotation);
    let half = atan2(v.dot(v).sqrt(), w.abs());
    half + half
}

/// Quaternion of a rotation times four times its largest entry: longest row of `4 q q^T`.
#[inline(always)]
fn quaternion_ray<L: Lane>(rotation: &Matrix3<L>) -> (L, Vector3<L>) {
    let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = rotation.0;
    let one = L::c(1.0);
    let (turn_x, turn_y, turn_z) = (zy - yz, xz - zx, yx - xy);
    let (sum_x, sum_y, sum_z) = (zy + yz, xz + zx, yx + xy);
    let (above, below) = (one + xx, one - xx);
    let (plus, minus) = (yy + zz, yy - zz);
    let rows = [
        [above + plus, turn_x, turn_y, turn_z],
        [turn_x, above - plus, sum_z, sum_y],
        [turn_y, sum_z, below + minus, sum_x],
        [turn_z, sum_y, sum_x, below - minus],
    ];
    let (mut longest, mut row) = (rows[0][0], rows[0]);
    for i in 1..4 {
        let longer = longest.lt(rows[i][i]);
        longest = L::select(longer, rows[i][i], longest);
        unroll!(k in 0 1 2 3 => {
            row[k] = L::select(longer, rows[i][k], row[k]);
        });
    }
    (row[0], Vector3([row[1], row[2], row[3]]))
}

//! Conversion between Fossen's body axes (x forward, y starboard, z down) and the project's (x forward, y left, z up) by
//! `S = diag(1, -1, -1)`, which is its own inverse.

use nalgebra::{SMatrix, Vector3};

/// True for the entries of a 3-vector, or of each half of a 6-vector, along y and z.
fn changes_sign(i: usize) -> bool {
    !i.is_multiple_of(3)
}

/// `-x`, with 0 for 0.
fn negate(x: &mut f64) {
    *x = 0.0 - *x;
}

/// `S v`
pub fn flip(v: &mut Vector3<f64>) {
    negate(&mut v.y);
    negate(&mut v.z);
}

/// `diag(S, S) w` of a 6-vector.
pub fn flip_six(w: &mut [f64; 6]) {
    w.iter_mut().enumerate().filter(|(i, _)| changes_sign(*i)).for_each(|(_, x)| negate(x));
}

/// `S J S` or `diag(S, S) M diag(S, S)`
pub fn flip_matrix<const N: usize>(m: &mut SMatrix<f64, N, N>) {
    for i in 0..N {
        for k in 0..N {
            if changes_sign(i) != changes_sign(k) {
                negate(&mut m[(i, k)]);
            }
        }
    }
}

/// The vector with length 1; unchanged where its length is 1 up to rounding.
pub fn normalise(axis: &mut Vector3<f64>) {
    if (axis.norm() - 1.0).abs() > 4.0 * f64::EPSILON {
        axis.normalize_mut();
    }
}

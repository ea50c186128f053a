//! Added mass of an ellipsoid in potential flow, exact. `[Lamb, Hydrodynamics, 1932, art. 114 and 115]`

use std::f64::consts::PI;

use nalgebra::Vector3;

/// Carlson's elliptic integral R_D, by his duplication theorem. `[Carlson, Numerical Algorithms 10, 1995]`
fn r_d(mut x: f64, mut y: f64, mut z: f64) -> f64 {
    let (mut sum, mut power) = (0.0, 1.0);
    loop {
        let mean = (x + y + 3.0 * z) / 5.0;
        let spread = [x, y, z].iter().map(|a| (1.0 - a / mean).abs()).fold(0.0, f64::max);
        if spread < 1e-3 {
            let (a, b, c) = (1.0 - x / mean, 1.0 - y / mean, 1.0 - z / mean);
            let (ab, cc) = (a * b, c * c);
            let (e2, e3) = (ab - 6.0 * cc, (3.0 * ab - 8.0 * cc) * c);
            let (e4, e5) = (3.0 * (ab - cc) * cc, ab * cc * c);
            let series =
                1.0 - 3.0 / 14.0 * e2 + e3 / 6.0 + 9.0 / 88.0 * e2 * e2 - 3.0 / 22.0 * e4 - 9.0 / 52.0 * e2 * e3
                    + 3.0 / 26.0 * e5;
            return 3.0 * sum + power * series / (mean * mean.sqrt());
        }
        let (rx, ry, rz) = (x.sqrt(), y.sqrt(), z.sqrt());
        let lambda = rx * ry + ry * rz + rz * rx;
        sum += power / (rz * (z + lambda));
        power /= 4.0;
        (x, y, z) = ((x + lambda) / 4.0, (y + lambda) / 4.0, (z + lambda) / 4.0);
    }
}

/// Diagonal of the added mass of an ellipsoid about its centre, along its axes.
pub fn ellipsoid(semi_axes: Vector3<f64>, density: f64) -> [f64; 6] {
    let square = semi_axes.component_mul(&semi_axes);
    let product = semi_axes.product();
    let displaced = 4.0 / 3.0 * PI * density * product;
    // alpha_0, beta_0, gamma_0.
    let shape = Vector3::from_fn(|i, _| 2.0 / 3.0 * product * r_d(square[(i + 1) % 3], square[(i + 2) % 3], square[i]));
    std::array::from_fn(|i| {
        if i < 3 {
            return displaced * shape[i] / (2.0 - shape[i]);
        }
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let difference = square[j] - square[k];
        // Proportional to the square of the difference: 0 for a body of revolution.
        if difference.abs() < 1e-6 * square[j].max(square[k]) {
            return 0.0;
        }
        let (sum, split) = (square[j] + square[k], shape[k] - shape[j]);
        displaced / 5.0 * difference * difference * split / (2.0 * difference - sum * split)
    })
}

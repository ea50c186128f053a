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

/// Diagonal of the added mass about the centre, along the axes, of an ellipsoid of these semi-axes.
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
        // It goes with the square of the difference, to 0 for a body of revolution.
        if difference.abs() < 1e-6 * square[j].max(square[k]) {
            return 0.0;
        }
        let (sum, split) = (square[j] + square[k], shape[k] - shape[j]);
        displaced / 5.0 * difference * difference * split / (2.0 * difference - sum * split)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn factors(x: f64, y: f64, z: f64) -> [f64; 6] {
        let displaced = 4.0 / 3.0 * PI * x * y * z;
        let masses = ellipsoid(Vector3::new(x, y, z), 1.0);
        let moments = [y * y + z * z, z * z + x * x, x * x + y * y].map(|s| displaced * s / 5.0);
        std::array::from_fn(|i| if i < 3 { masses[i] / displaced } else { masses[i] / moments[i - 3] })
    }

    #[test]
    fn val_a_sphere_carries_half_of_the_water_it_displaces() {
        let k = factors(0.7, 0.7, 0.7);
        assert!(k[..3].iter().all(|k| (k - 0.5).abs() < 1e-14) && k[3..] == [0.0; 3], "{k:?}");
    }

    /// The closed form of prolate spheroids, and Lamb's own table of them in art. 115, computed by hand.
    #[test]
    fn val_spheroids_have_lambs_factors() {
        for (slenderness, k1, k2, turning) in [
            (1.5f64, 0.305, 0.621, 0.094),
            (2.0, 0.209, 0.702, 0.240),
            (3.99, 0.082, 0.860, 0.608),
            (6.01, 0.045, 0.918, 0.764),
            (9.97, 0.021, 0.960, 0.883),
        ] {
            let k = factors(slenderness, 1.0, 1.0);
            let off = [k[0] - k1, k[1] - k2, k[4] - turning].map(f64::abs);
            assert!(off.iter().all(|off| *off < 3e-3), "{slenderness}: {k:?}");
            assert_eq!((k[1], k[4], k[3]), (k[2], k[5], 0.0));

            let e = (1.0 - slenderness.powi(-2)).sqrt();
            let log = ((1.0 + e) / (1.0 - e)).ln();
            let alpha = 2.0 * (1.0 - e * e) / e.powi(3) * (log / 2.0 - e);
            let beta = 1.0 / (e * e) - (1.0 - e * e) / (2.0 * e.powi(3)) * log;
            let axial = e.powi(4) * (beta - alpha) / ((2.0 - e * e) * (2.0 * e * e - (2.0 - e * e) * (beta - alpha)));
            let closed = [alpha / (2.0 - alpha), beta / (2.0 - beta), axial];
            let off = [k[0] - closed[0], k[1] - closed[1], k[4] - closed[2]].map(f64::abs);
            assert!(off.iter().all(|off| *off < 1e-13), "{slenderness}: {k:?} {closed:?}");
        }
    }

    #[test]
    fn val_a_flat_ellipsoid_is_a_disc() {
        let k = ellipsoid(Vector3::new(1e-5, 1.0, 1.0), 1.0);
        assert!((k[0] - 8.0 / 3.0).abs() < 1e-3 && (k[4] - 16.0 / 45.0).abs() < 1e-3, "{k:?}");
    }

    #[test]
    fn a_long_ellipsoid_is_a_cylinder_of_elliptic_section() {
        // Per length: pi rho c^2 for motion along b, and pi/8 rho (b^2 - c^2)^2 for turning; integrated along the axis.
        let (a, b, c) = (1000.0, 2.0, 1.0);
        let k = ellipsoid(Vector3::new(a, b, c), 1.0);
        let along = 4.0 / 3.0 * a;
        assert!((k[1] / (PI * c * c * along) - 1.0).abs() < 1e-3, "{k:?}");
        let turning = PI / 8.0 * 9.0 * 16.0 / 15.0 * a;
        assert!((k[3] / turning - 1.0).abs() < 1e-3, "{k:?} {turning}");
    }
}

//! Added mass of an ellipsoid in potential flow, exact. `[Lamb, Hydrodynamics, 1932, art. 114 and 115]`

use std::f64::consts::PI;

use nalgebra::Vector3;
use uvms_gym::estimate::lamb::ellipsoid;

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

//! Mass, added mass and drag of one solid, about its centre and along its own axes.

use std::f64::consts::PI;

use nalgebra::Vector3;
use uvms_gym::estimate::solid::Solid;
use uvms_gym::estimate::{Axis, Ends, Round};

const RHO: f64 = 1000.0;

fn close(a: &[f64], b: &[f64], tolerance: f64) {
    for (a, b) in a.iter().zip(b) {
        assert!((a - b).abs() <= tolerance * b.abs().max(1e-9), "{a} is not {b}");
    }
}

#[test]
fn val_a_cube_has_the_published_coefficients() {
    let cube = Solid::Box(Vector3::repeat(0.7));
    close(&cube.added_mass(RHO, Ends::Free), &[233.24, 233.24, 233.24, 7.722, 7.722, 7.722], 1e-3);
    close(&cube.quadratic_damping(RHO, Ends::Free)[..1], &[0.5 * RHO * 1.05 * 0.49], 1e-12);
}

#[test]
fn val_flat_boxes_are_plates_and_long_ones_are_strips() {
    let plate = Solid::Box(Vector3::new(1e-9, 1.0, 2.0)).added_mass(RHO, Ends::Free);
    close(&plate[..1], &[0.757 * PI / 4.0 * 2.0 * RHO], 1e-6);
    let bar = Solid::Box(Vector3::new(1e6, 1.0, 1.0));
    let free = bar.added_mass(RHO, Ends::Free);
    close(&free[1..3], &[1.51 * PI / 4.0 * 1e9; 2], 1e-5);
    close(&free[1..], &bar.added_mass(RHO, Ends::Joined)[1..], 1e-5);
}

#[test]
fn a_short_capsule_is_a_sphere() {
    let (capsule, sphere) =
        (Solid::Capsule(Round { radius: 0.2, length: 1e-9, axis: Axis::Y }), Solid::Ellipsoid(Vector3::repeat(0.2)));
    close(&[capsule.volume()], &[sphere.volume()], 1e-7);
    close(capsule.inertia(3.0).as_slice(), sphere.inertia(3.0).as_slice(), 1e-7);
    close(&capsule.added_mass(RHO, Ends::Free)[..3], &sphere.added_mass(RHO, Ends::Free)[..3], 1e-7);
    close(&capsule.quadratic_damping(RHO, Ends::Free)[..3], &sphere.quadratic_damping(RHO, Ends::Free)[..3], 1e-7);
}

#[test]
fn val_a_thin_disc_carries_what_lamb_says() {
    let disc = Solid::Cylinder(Round { radius: 0.5, length: 1e-6, axis: Axis::Z }).added_mass(RHO, Ends::Free);
    close(&disc[2..4], &[8.0 / 3.0 * RHO * 0.125, 16.0 / 45.0 * RHO * 0.5f64.powi(5)], 1e-5);
    assert!(disc[0] < 1e-3);
}

/// Scaled by s, mass goes with s^3, moments with s^5, drag with s^2 and drag's moments with s^5.
#[test]
fn estimates_scale_as_their_dimensions() {
    let solids = |s: f64| {
        [
            Solid::Box(Vector3::new(0.5, 0.3, 0.2) * s),
            Solid::Ellipsoid(Vector3::new(0.5, 0.3, 0.2) * s),
            Solid::Cylinder(Round { radius: 0.1 * s, length: 0.7 * s, axis: Axis::X }),
            Solid::Capsule(Round { radius: 0.1 * s, length: 0.7 * s, axis: Axis::Z }),
        ]
    };
    for (one, two) in solids(1.0).iter().zip(solids(2.0)) {
        for ends in [Ends::Free, Ends::Joined] {
            let (a, b) = (one.added_mass(RHO, ends), two.added_mass(RHO, ends));
            close(&b, &std::array::from_fn::<_, 6, _>(|i| a[i] * if i < 3 { 8.0 } else { 32.0 }), 1e-12);
            let (a, b) = (one.quadratic_damping(RHO, ends), two.quadratic_damping(RHO, ends));
            close(&b, &std::array::from_fn::<_, 6, _>(|i| a[i] * if i < 3 { 4.0 } else { 32.0 }), 1e-12);
            assert!(a.iter().all(|x| *x >= 0.0 && x.is_finite()));
        }
        close(&[two.inertia(1.0).sum()], &[4.0 * one.inertia(1.0).sum()], 1e-12);
    }
}

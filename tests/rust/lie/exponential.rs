//! exp, and rotation by it.

use std::f64::consts::PI;

use nalgebra as na;
use serde::Deserialize;
use uvms_gym::lie::{DexpInverse, Vector3, dexp_inverse_negative, exp_se3, rotate_back};

use super::{angles, dense, hat, lanes, of_angle, over_factorial, series, six};
use crate::random_scene::Random;

/// exp at 60 digits, `tests/golden/exponential.py`.
#[derive(Deserialize)]
struct Golden {
    angle: f64,
    xi: [f64; 6],
    twist: [f64; 6],
    rotation: [[f64; 3]; 3],
    position: [f64; 3],
    rate: [f64; 6],
}

#[test]
fn val_exponential_and_inverse_of_dexp_at_sixty_digits() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/exponential.json");
    let cases: Vec<Golden> = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    assert!(cases.len() > 40);
    let mut worst = [0.0_f64; 2];
    for case in &cases {
        let pose = exp_se3(lanes(&case.xi.into()));
        let rotation = (dense(&pose.rotation) - na::Matrix3::from_fn(|i, k| case.rotation[i][k])).amax();
        let position = (na::Vector3::from(pose.position.0) - na::Vector3::from(case.position)).amax();
        let rate = six(dexp_inverse_negative(DexpInverse::Closed, lanes(&case.xi.into()), lanes(&case.twist.into())));
        let rate = (rate - na::Vector6::from(case.rate)).amax();
        let bar = 2e-15;
        assert!(rotation.max(position) < bar, "exp, angle {}: {rotation:e} {position:e}", case.angle);
        assert!(rate < 2.0 * bar, "dexp, angle {}: {rate:e}", case.angle);
        worst = [worst[0].max(rotation).max(position), worst[1].max(rate)];
        // The antisymmetric part is the angle itself, to its last digit: small turns are not lost.
        if case.angle > 0.0 && case.angle < 1.0 {
            let r = dense(&pose.rotation);
            let turn = na::Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]);
            let g = &case.rotation;
            let exact = na::Vector3::new(g[2][1] - g[1][2], g[0][2] - g[2][0], g[1][0] - g[0][1]);
            assert!((turn - exact).norm() < 1e-15 * exact.norm().max(case.angle), "{}", case.angle);
        }
    }
    println!("maximum errors up to 3.6 rad: exp {:e}, dexp^-1 {:e}", worst[0], worst[1]);
}

#[test]
fn exponential_is_the_matrix_exponential() {
    let mut random = Random::new(1);
    for angle in angles(1e-12, 1.05 * PI, 400) {
        let xi = of_angle(&mut random, angle);
        let pose = exp_se3(lanes(&xi));
        let expected = series(&hat(&xi), over_factorial);
        let rotation = dense(&pose.rotation) - expected.fixed_view::<3, 3>(0, 0);
        let position = na::Vector3::from(pose.position.0) - expected.fixed_view::<3, 1>(0, 3);
        assert!(rotation.amax() < 1e-14 && position.amax() < 1e-14, "{angle}: {rotation} {position}");
    }
}

#[test]
fn exponentials_of_one_direction_add_up() {
    let mut random = Random::new(3);
    for angle in angles(1e-10, 1.5, 100) {
        let xi = of_angle(&mut random, angle);
        let (a, b) = (exp_se3(lanes(&xi)), exp_se3(lanes(&(xi * 0.7))));
        let sum = exp_se3(lanes(&(xi * 1.7)));
        let product = a.times(&b);
        assert!((dense(&product.rotation) - dense(&sum.rotation)).amax() < 2e-15);
        assert!((na::Vector3::from(product.position.0) - na::Vector3::from(sum.position.0)).amax() < 2e-15);
    }
}

#[test]
fn exponential_is_a_rotation_up_to_pi() {
    let mut random = Random::new(4);
    for angle in angles(1e-12, PI, 500) {
        let r = dense(&exp_se3(lanes(&of_angle(&mut random, angle))).rotation);
        assert!((r.transpose() * r - na::Matrix3::identity()).amax() < 4e-15, "{angle}");
        assert!((r.determinant() - 1.0).abs() < 4e-15);
    }
}

#[test]
fn rotating_back_undoes_the_exponential() {
    let mut random = Random::new(5);
    for angle in angles(1e-12, PI, 300) {
        let xi = of_angle(&mut random, angle);
        let x = random.vector(1.0);
        let r = dense(&exp_se3(lanes(&xi)).rotation);
        let back = rotate_back(lanes(&xi).angular, Vector3(x.into()));
        assert!((na::Vector3::from(back.0) - r.transpose() * x).amax() < 2e-15, "{angle}");
    }
}

/// No switch, no jump: neighbours on a fine grid differ as their angles do.
#[test]
fn nothing_jumps_between_a_nanoradian_and_pi() {
    let mut random = Random::new(6);
    let (direction, twist) = (of_angle(&mut random, 1.0), of_angle(&mut random, 1.0));
    let values = |angle: f64| {
        let mut xi = direction;
        xi.fixed_rows_mut::<3>(3).scale_mut(angle);
        let pose = exp_se3(lanes(&xi));
        let rate = dexp_inverse_negative(DexpInverse::Closed, lanes(&xi), lanes(&twist)).to_array();
        let rotation = pose.rotation.0.into_iter().flatten();
        rotation.chain(pose.position.0).chain(rate).collect::<Vec<f64>>()
    };
    let grid: Vec<f64> = angles(1e-9, PI, 20_000).collect();
    let mut before = values(grid[0]);
    for pair in grid.windows(2) {
        let here = values(pair[1]);
        for (a, b) in before.iter().zip(&here) {
            // Slopes by the angle are of order one; the rest is rounding.
            assert!((a - b).abs() < 4.0 * (pair[1] - pair[0]) + 2e-15, "between {} and {}: {a} {b}", pair[0], pair[1]);
        }
        before = here;
    }
}

//! dexp^-1, closed and cut off.

use std::f64::consts::PI;

use nalgebra as na;
use uvms_gym::lie::{DexpInverse, Pose, dexp_inverse_negative, exp_se3};

use super::{ad_matrix, angles, dense, dexp_negative, lanes, of_angle, six};
use crate::random_scene::Random;

fn inverse(form: DexpInverse, theta: &na::Vector6<f64>, v: &na::Vector6<f64>) -> na::Vector6<f64> {
    six(dexp_inverse_negative(form, lanes(theta), lanes(v)))
}

#[test]
fn inverse_of_dexp_undoes_dexp() {
    let mut random = Random::new(1);
    let mut worst = 0.0_f64;
    for angle in angles(1e-12, 1.05 * PI, 500) {
        let theta = of_angle(&mut random, angle);
        let v = of_angle(&mut random, 1.0);
        let back = dexp_negative(&theta) * inverse(DexpInverse::Closed, &theta, &v);
        worst = worst.max((back - v).amax());
        assert!((back - v).amax() < 2e-14, "{angle}: {:e}", (back - v).amax());
    }
    println!("dexp(dexp^-1 V) - V up to 1.05 pi: {worst:e}");
}

/// `dexp^-1_(-theta) = sum (-1)^k B_k / k! ad^k` with Bernoulli's numbers, up to 2 pi.
#[test]
fn inverse_of_dexp_has_bernoullis_coefficients() {
    // B_2k / (2k)! = (-1)^(k+1) 2 zeta(2k) / (2 pi)^2k.
    let zeta = |k: i32| match k {
        2 => PI.powi(2) / 6.0,
        4 => PI.powi(4) / 90.0,
        6 => PI.powi(6) / 945.0,
        8 => PI.powi(8) / 9450.0,
        10 => PI.powi(10) / 93555.0,
        _ => (1..60).rev().map(|n| f64::from(n).powi(-k)).sum(),
    };
    let bernoulli = |k: i32| match k {
        0 => 1.0,
        1 => -0.5,
        k if k % 2 == 1 => 0.0,
        k => (if k % 4 == 2 { 2.0 } else { -2.0 }) * zeta(k) / (2.0 * PI).powi(k),
    };
    let coefficients: Vec<f64> = (0..120).map(bernoulli).collect();
    let mut random = Random::new(2);
    for angle in angles(1e-6, PI, 60) {
        let theta = of_angle(&mut random, angle);
        let v = of_angle(&mut random, 1.0);
        let ad = ad_matrix(&theta);
        let (mut power, mut sum) = (v, na::Vector6::zeros());
        for (k, b) in coefficients.iter().enumerate() {
            sum += power * if k % 2 == 0 { *b } else { -b };
            power = ad * power;
        }
        let got = inverse(DexpInverse::Closed, &theta, &v);
        assert!((got - sum).amax() < 1e-14, "{angle}: {:e}", (got - sum).amax());
    }
}

/// The definition itself: a body that moves as exp(theta(t)) with theta' = dexp^-1 V has the twist V.
#[test]
fn exponential_along_the_inverse_of_dexp_moves_at_the_body_twist() {
    let mut random = Random::new(3);
    for angle in [1e-9, 1e-4, 0.1, 1.0, 2.0, 3.0, PI] {
        let theta = of_angle(&mut random, angle);
        let v = of_angle(&mut random, 1.0);
        let rate = inverse(DexpInverse::Closed, &theta, &v);
        let at = |t: f64| -> Pose<f64> { exp_se3(lanes(&(theta + rate * t))) };
        let here = at(0.0);
        let seen = |t: f64| {
            let there = at(t);
            let w = dense(&here.rotation).transpose() * dense(&there.rotation);
            let p = na::Vector3::from(there.position.0) - na::Vector3::from(here.position.0);
            let p = dense(&here.rotation).transpose() * p;
            na::Vector6::new(p.x, p.y, p.z, w[(2, 1)], w[(0, 2)], w[(1, 0)])
        };
        let central = |h: f64| (seen(h) - seen(-h)) / (2.0 * h);
        let h = 1e-2;
        let twist = (central(h / 2.0) * 4.0 - central(h)) / 3.0;
        let twist = (((central(h / 4.0) * 4.0 - central(h / 2.0)) / 3.0) * 16.0 - twist) / 15.0;
        assert!((twist - v).amax() < 1e-11, "{angle}: {:e}", (twist - v).amax());
    }
}

#[test]
fn inverse_of_dexp_of_a_vector_along_itself_is_the_vector() {
    let mut random = Random::new(4);
    for angle in angles(1e-9, PI, 50) {
        let theta = of_angle(&mut random, angle);
        for form in [DexpInverse::Closed, DexpInverse::Truncated] {
            assert!((inverse(form, &theta, &theta) - theta).amax() < 1e-15);
        }
    }
}

/// What is cut off begins with `-B_4/4! ad^4 = ad^4 / 720`.
#[test]
fn truncated_inverse_is_off_by_the_fourth_power() {
    let mut random = Random::new(5);
    let (direction, v) = (of_angle(&mut random, 1.0), of_angle(&mut random, 1.0));
    let error = |scale: f64| {
        let theta = direction * scale;
        inverse(DexpInverse::Truncated, &theta, &v) - inverse(DexpInverse::Closed, &theta, &v)
    };
    for scale in [0.8, 0.4, 0.2, 0.1] {
        let order = (error(scale).norm() / error(scale / 2.0).norm()).log2();
        assert!((order - 4.0).abs() < 0.05, "{scale}: {order}");
    }
    let ad = ad_matrix(&(direction * 0.05));
    let leading = ad * ad * ad * ad * v / 720.0;
    assert!((error(0.05) - leading).norm() < 1e-3 * leading.norm(), "{} {leading}", error(0.05));
}

#[test]
fn beyond_pi_the_closed_form_degrades_slowly() {
    let mut random = Random::new(6);
    for (factor, bar) in [(1.0, 4e-15), (1.1, 4e-15), (1.3, 1e-14), (1.5, 1e-12)] {
        let theta = of_angle(&mut random, factor * PI);
        let v = of_angle(&mut random, 1.0);
        let exact = dexp_negative(&theta).lu().solve(&v).unwrap();
        let error = (inverse(DexpInverse::Closed, &theta, &v) - exact).amax();
        println!("{factor} pi: {error:e}");
        assert!(error < bar, "{factor} pi: {error:e}");
    }
}

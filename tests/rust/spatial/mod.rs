//! Spatial inertia in 21 numbers and the screw moves, against plain 6x6 matrices and general changes of frame.

mod point;

use std::f64::consts::{FRAC_PI_2, PI};

use crate::lie::{adjoint, lanes, rows, six};
use crate::random_scene::Random;
use nalgebra as na;
use proptest::prelude::*;
use uvms_gym::lane::Shared;
use uvms_gym::lie::{Pose, Vector3, Vector6, ad};
use uvms_gym::spatial::{LinkTwist, Screw, SpatialInertia, constant_screw_z, screw_x, screw_z};

fn dense(a: &SpatialInertia<f64>) -> na::Matrix6<f64> {
    na::Matrix6::from_fn(|i, k| a.entry(i, k))
}

fn packed(m: &na::Matrix6<f64>) -> SpatialInertia<f64> {
    SpatialInertia::from_entries(|i, k| m[(i, k)])
}

fn matrix6(random: &mut Random) -> na::Matrix6<f64> {
    na::Matrix6::from_fn(|_, _| random.between(-1.0, 1.0))
}

/// Symmetric positive definite, condition number within about a thousand.
fn definite(random: &mut Random) -> na::Matrix6<f64> {
    let g = matrix6(random);
    let m = g * g.transpose() + na::Matrix6::identity() * 0.05;
    (m + m.transpose()) / 2.0
}

fn vector6(random: &mut Random) -> na::Vector6<f64> {
    na::Vector6::from_fn(|_, _| random.between(-1.0, 1.0))
}

fn pose_of(r: &na::Matrix3<f64>, p: &na::Vector3<f64>) -> Pose<f64> {
    Pose { rotation: rows(r), position: Vector3((*p).into()) }
}

proptest! {
    #[test]
    fn packed_inertia_is_its_matrix(seed in any::<u64>()) {
        let random = &mut Random::new(seed);
        let (m, n, v) = (definite(random), definite(random), vector6(random));
        let (a, b) = (packed(&m), packed(&n));
        prop_assert_eq!(dense(&a), m);
        prop_assert!((six(a.apply(lanes(&v))) - m * v).amax() < 1e-14);
        prop_assert_eq!(dense(&a.plus(&b)), m + n);
        prop_assert_eq!(dense(&a.map(Shared).get::<f64>()), m);
    }

    #[test]
    fn inertia_moves_as_a_form_of_the_adjoint(seed in any::<u64>()) {
        let random = &mut Random::new(seed);
        let m = definite(random);
        let (r, p) = (random.rotation(), random.vector(1.0));
        // Of the inverse pose: a general inverse of the adjoint's matrix has more error than the tolerance in one of 10 000 cases.
        let ad = adjoint(&pose_of(&r.transpose(), &(-r.transpose() * p)));
        prop_assert!((dense(&packed(&m).to_parent(&pose_of(&r, &p))) - ad.transpose() * m * ad).amax() < 2e-14);
    }

    #[test]
    fn solve_is_the_inverse(seed in any::<u64>()) {
        let random = &mut Random::new(seed);
        let (m, b) = (definite(random), vector6(random));
        let x = six(packed(&m).solve(lanes(&b)));
        prop_assert!((m * x - b).norm() < 1e-14 * m.norm() * x.norm());
        let expected = m.cholesky().unwrap().solve(&b);
        let eigenvalues = m.symmetric_eigenvalues();
        prop_assert!((x - expected).norm() < 4e-15 * eigenvalues.max() / eigenvalues.min() * x.norm());
    }

    #[test]
    fn eliminating_a_direction_frees_it(seed in any::<u64>(), axis in 0..6_usize) {
        let random = &mut Random::new(seed);
        let m = definite(random);
        let a = packed(&m);
        let direction = na::Vector6::ith(axis, 1.0);
        let u = m * direction;
        let rest = a.eliminated(lanes(&u), 1.0 / u[axis]);
        prop_assert!((dense(&rest) - (m - u * u.transpose() / u[axis])).amax() < 4e-14 * m.amax());
        // No wrench is needed to accelerate along it, nor does it feel any.
        prop_assert!(six(rest.apply(lanes(&direction))).amax() < 1e-14 * m.amax());
    }

    #[test]
    fn short_forms_of_an_inertia_of_mostly_zeros_are_the_general_ones(seed in any::<u64>()) {
        let random = &mut Random::new(seed);
        let (mut sparse, carried, v) = (packed(&matrix6(random)), packed(&definite(random)), lanes(&vector6(random)));
        prop_assert!(!sparse.is_sparse());
        for k in [1, 2, 4] {
            sparse.m[k] = 0.0;
        }
        for k in 0..3 {
            sparse.h[k][k] = 0.0;
        }
        (sparse.j[1], sparse.j[4]) = (0.0, 0.0);
        prop_assert!(sparse.is_sparse());
        prop_assert_eq!(carried.plus_own::<f64, true>(&sparse), carried.plus(&sparse));
        prop_assert_eq!(carried.plus_own::<f64, false>(&sparse), carried.plus(&sparse));
        prop_assert_eq!(six(sparse.sparse_bias_wrench(v)), six(sparse.bias_wrench(v)));
    }

    /// `B V = -ad_V^T A V`: does no work, and is quadratic.
    #[test]
    fn bias_wrench_is_of_the_algebra_and_does_no_work(seed in any::<u64>()) {
        let random = &mut Random::new(seed);
        let (m, v, w) = (definite(random), vector6(random), vector6(random));
        let a = packed(&m);
        let bias = a.bias_wrench(lanes(&v));
        // <B V, w> = -<A V, ad_V w>
        let expected = -a.apply(lanes(&v)).dot(ad(lanes(&v), lanes(&w)));
        prop_assert!((bias.dot(lanes(&w)) - expected).abs() < 1e-13);
        prop_assert!(bias.dot(lanes(&v)).abs() < 1e-13);
        let doubled = six(a.bias_wrench(lanes(&(v * 2.0))));
        prop_assert!((doubled - six(bias) * 4.0).amax() < 1e-14);
    }

    #[test]
    fn bias_wrench_moves_as_a_wrench(seed in any::<u64>()) {
        let random = &mut Random::new(seed);
        let (m, v) = (definite(random), vector6(random));
        let pose = pose_of(&random.rotation(), &random.vector(1.0));
        let here = packed(&m).to_parent(&pose).bias_wrench(lanes(&v));
        let there = packed(&m).bias_wrench(pose.adjoint_apply_inverse(lanes(&v)));
        prop_assert!((six(here) - six(pose.co_adjoint_apply_inverse(there))).amax() < 1e-12);
    }

    /// About x and about z, by any angle and by those that need no sine: each is the general change of frame.
    #[test]
    fn screw_moves_are_changes_of_frame(seed in any::<u64>(), angle in -3.2..3.2_f64, shift in -2.0..2.0_f64) {
        let random = &mut Random::new(seed);
        let (sin, cos) = angle.sin_cos();
        for (bend, angle) in [
            (LinkTwist::Deg0, 0.0),
            (LinkTwist::Deg90, FRAC_PI_2),
            (LinkTwist::Deg180, PI),
            (LinkTwist::General(sin, cos), angle),
        ] {
            let (x, z) = (na::Vector3::x(), na::Vector3::z());
            check_screw(random, &screw_x(bend, Some(shift)), x, angle, shift)?;
            check_screw(random, &screw_x(bend, None), x, angle, 0.0)?;
            check_screw(random, &constant_screw_z(bend, Some(shift)), z, angle, shift)?;
        }
        check_screw(random, &screw_z(sin, cos, Some(shift)), na::Vector3::z(), angle, shift)?;
        check_screw(random, &screw_z(sin, cos, None), na::Vector3::z(), angle, 0.0)?;
    }

    /// The short forms for what a revolute joint leaves: an inertia without row and column of its own rotation.
    #[test]
    fn short_forms_of_a_free_turn_are_the_general_ones(seed in any::<u64>(), angle in -3.2..3.2_f64, shift in -2.0..2.0_f64) {
        let random = &mut Random::new(seed);
        let a = packed(&definite(random));
        let u = a.apply(lanes(&na::Vector6::ith(5, 1.0)));
        let over_d = 1.0 / u.angular.0[2];
        let (rest, share, inverse) = a.eliminate_revolute();
        prop_assert!((six(share) - six(u) * over_d).amax() < 1e-15 && inverse == over_d);
        let scale = dense(&a).amax();
        prop_assert!((dense(&rest) - dense(&a.eliminated(u, over_d))).amax() < 4e-14 * scale);
        prop_assert!((0..6).all(|k| rest.entry(5, k) == 0.0 && rest.entry(k, 5) == 0.0));
        let (sin, cos) = angle.sin_cos();
        let quarter = constant_screw_z(LinkTwist::Deg90, Some(shift));
        for screw in [screw_z(sin, cos, Some(shift)), screw_z(sin, cos, None), quarter] {
            let (short, general) = (screw.revolute_inertia_to_parent(&rest), screw.inertia_to_parent(&rest));
            prop_assert!((dense(&short) - dense(&general)).amax() < 1e-14 * scale);
        }
        let (mut c, p) = (vector6(random), vector6(random));
        (c[2], c[5]) = (0.0, 0.0);
        let (expected, mut sum) = (six(rest.apply(lanes(&c))) + p, lanes(&p));
        rest.apply_across([c[0], c[1], c[3], c[4]], &mut sum);
        prop_assert!((six(sum) - expected).amax() < 1e-14 * scale);
    }
}

/// A screw against the pose of the same turn and shift.
fn check_screw<const ALONG: usize>(
    random: &mut Random,
    screw: &Screw<f64, f64, ALONG>,
    axis: na::Vector3<f64>,
    angle: f64,
    shift: f64,
) -> Result<(), TestCaseError> {
    let pose = pose_of(na::Rotation3::new(axis * angle).matrix(), &(axis * shift));
    let (v, f, m) = (vector6(random), vector6(random), definite(random));
    let near = |a: Vector6<f64>, b: Vector6<f64>| (six(a) - six(b)).amax() < 4e-15;
    prop_assert!(near(screw.adjoint_apply_inverse(lanes(&v)), pose.adjoint_apply_inverse(lanes(&v))));
    prop_assert!(near(screw.co_adjoint_apply_inverse(lanes(&f)), pose.co_adjoint_apply_inverse(lanes(&f))));
    let vector = lanes(&v).linear;
    let turned = |a: Vector3<f64>, b: Vector3<f64>| (0..3).all(|i| (a.0[i] - b.0[i]).abs() < 1e-15);
    prop_assert!(turned(screw.rotate(vector), pose.rotation.apply(vector)));
    let (back, twist) = screw.both_from_parent(vector, lanes(&v));
    prop_assert!(turned(back, pose.rotation.apply_transposed(vector)));
    prop_assert_eq!(six(twist), six(screw.adjoint_apply_inverse(lanes(&v))));
    let (special, general) = (screw.inertia_to_parent(&packed(&m)), packed(&m).to_parent(&pose));
    prop_assert!((dense(&special) - dense(&general)).amax() < 4e-14, "{}", dense(&special) - dense(&general));
    Ok(())
}

#[test]
fn bend_changes_its_numbers_only() {
    assert_eq!(LinkTwist::<f64>::Deg0.map(|x| x + 1.0), LinkTwist::Deg0);
    assert_eq!(LinkTwist::<f64>::Deg90.map(|x| x + 1.0), LinkTwist::Deg90);
    assert_eq!(LinkTwist::General(0.5, 0.25).map(|x| x + 1.0), LinkTwist::General(1.5, 1.25));
}

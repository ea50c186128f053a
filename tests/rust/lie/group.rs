//! Laws of the group, its algebra and their adjoints.

use nalgebra as na;
use proptest::prelude::*;
use uvms_gym::lie::{Matrix3, Pose, Vector3, ad, exp_se3};

use super::{ad_matrix, adjoint, dense, lanes, random_pose, rows, six};
use crate::random_scene::Random;

fn vector6(size: f64) -> impl Strategy<Value = na::Vector6<f64>> {
    prop::array::uniform6(-size..size).prop_map(Into::into)
}

fn pose() -> impl Strategy<Value = Pose<f64>> {
    any::<u64>().prop_map(|seed| random_pose(&mut Random::new(seed)))
}

proptest! {
    #[test]
    fn adjoint_acts_as_its_matrix(t in pose(), v in vector6(3.0), f in vector6(3.0)) {
        let inverse = adjoint(&t).try_inverse().unwrap();
        prop_assert!((six(t.adjoint_apply_inverse(lanes(&v))) - inverse * v).amax() < 1e-13);
        prop_assert!((six(t.co_adjoint_apply_inverse(lanes(&f))) - inverse.transpose() * f).amax() < 1e-13);
    }

    #[test]
    fn adjoint_of_a_product_is_the_product_of_adjoints(a in pose(), b in pose(), v in vector6(2.0)) {
        let together = a.times(&b).adjoint_apply_inverse(lanes(&v));
        let one_by_one = b.adjoint_apply_inverse(a.adjoint_apply_inverse(lanes(&v)));
        prop_assert!((six(together) - six(one_by_one)).amax() < 1e-13);
    }

    #[test]
    fn ad_is_its_matrix_and_keeps_jacobis_identity(a in vector6(2.0), b in vector6(2.0), c in vector6(2.0)) {
        let [x, y, z] = [a, b, c].map(|v| lanes(&v));
        prop_assert!((six(ad(x, y)) - ad_matrix(&a) * b).amax() < 1e-14);
        let sum = six(ad(x, ad(y, z))) + six(ad(y, ad(z, x))) + six(ad(z, ad(x, y)));
        prop_assert!(sum.amax() < 1e-13);
        prop_assert!(six(ad(x, x)).amax() < 1e-15);
    }

    #[test]
    fn conjugation_moves_the_exponent_by_the_adjoint(t in pose(), xi in vector6(0.9)) {
        // T exp(Ad_T^-1 xi) = exp(xi) T
        let left = t.times(&exp_se3(t.adjoint_apply_inverse(lanes(&xi))));
        let right = exp_se3(lanes(&xi)).times(&t);
        prop_assert!((dense(&left.rotation) - dense(&right.rotation)).amax() < 1e-14);
        prop_assert!((na::Vector3::from(left.position.0) - na::Vector3::from(right.position.0)).amax() < 2e-14);
    }

    #[test]
    fn vectors_and_matrices_are_nalgebras(a in vector6(2.0), m in pose(), n in pose()) {
        let (u, v) = (a.fixed_rows::<3>(0).into_owned(), a.fixed_rows::<3>(3).into_owned());
        let of = |x: na::Vector3<f64>| Vector3::<f64>(x.into());
        let (p, q) = (m.rotation, n.rotation);
        let near = |x: Vector3<f64>, y: na::Vector3<f64>| (na::Vector3::from(x.0) - y).amax() < 1e-14;
        prop_assert!(near(of(u).cross(of(v)), u.cross(&v)));
        prop_assert!(near(of(u).cross_add(of(v), of(u)), u.cross(&v) + u));
        prop_assert!(near(of(u).scale_add(1.7, of(v)), u * 1.7 + v));
        prop_assert!(near(of(u) + of(v) - of(u).scale(0.5) + -of(v), u * 0.5));
        prop_assert!((of(u).dot(of(v)) - u.dot(&v)).abs() < 1e-14);
        prop_assert!(near(p.apply(of(u)), dense(&p) * u));
        prop_assert!(near(p.apply_transposed(of(u)), dense(&p).transpose() * u));
        prop_assert!((dense(&p.times(&q)) - dense(&p) * dense(&q)).amax() < 1e-14);
        prop_assert!((dense(&p.transposed()) - dense(&p).transpose()).amax() == 0.0);
    }

    #[test]
    fn orthonormalising_squares_the_defect(seed in any::<u64>(), size in 1e-9..1e-2_f64) {
        let mut random = Random::new(seed);
        let r = random.rotation();
        let noise = na::Matrix3::from_fn(|_, _| random.between(-size, size));
        let defect = |m: &na::Matrix3<f64>| (m.transpose() * m - na::Matrix3::identity()).norm();
        let noisy = r + noise;
        let once = dense(&rows(&noisy).orthonormalised());
        prop_assert!(defect(&once) < defect(&noisy).powi(2) + 2e-15);
        // Towards the nearest rotation: the polar factor.
        let svd = noisy.svd(true, true);
        let nearest = svd.u.unwrap() * svd.v_t.unwrap();
        prop_assert!((once - nearest).norm() < defect(&noisy).powi(2) + 4e-15);
    }
}

#[test]
fn exact_rotation_is_left_alone_by_orthonormalising() {
    let identity = Matrix3::<f64>::identity();
    assert_eq!(identity.orthonormalised(), identity);
}

//! Dual numbers: the kernel differentiates itself.

use uvms_gym::dynamics::aba::{ArmLoads, Instant, Scratch, accelerations};
use uvms_gym::lane::{Dual, Lane, Shared, horner, sin_cos};
use uvms_gym::lie::{DexpInverse, Matrix3, Pose, Vector3, Vector6, dexp_inverse_negative, exp_se3};
use uvms_gym::system::{JOINTS, System, compile};

use crate::random_scene::{Options, Random, random_scene, random_state};

/// Value and slope of `f` at `x` against Richardson's central difference of its values.
fn slope_is_right(name: &str, f: impl Fn(Dual) -> Dual, x: f64) {
    let at = |x: f64| f(Dual::new(x, 0.0)).value;
    let central = |h: f64| (at(x + h) - at(x - h)) / (2.0 * h);
    let h = 1e-3 * x.abs().max(0.1);
    let expected = (4.0 * central(h / 2.0) - central(h)) / 3.0;
    let got = f(Dual::new(x, 1.0));
    assert!((got.slope - expected).abs() < 1e-8 * expected.abs().max(1.0), "{name} at {x}: {} {expected}", got.slope);
    assert_eq!(got.value, at(x), "{name}: the slope changes the value");
    // The slope is linear in the direction.
    assert!((f(Dual::new(x, -2.5)).slope + 2.5 * got.slope).abs() < 1e-14 * got.slope.abs().max(1.0), "{name}");
}

#[test]
fn dual_numbers_differentiate() {
    for x in [-2.3, -0.4, 0.7, 3.9] {
        let y = Dual::new(1.3, 0.0);
        slope_is_right("+", |x| x + y * x, x);
        slope_is_right("-", |x| y - x, x);
        slope_is_right("*", |x| x * x * x, x);
        slope_is_right("/", |x| (x + y) / (x * x + y), x);
        slope_is_right("neg", |x| -x * x, x);
        slope_is_right("mul_add", |x| x.mul_add(x, x), x);
        slope_is_right("neg_mul_add", |x| x.neg_mul_add(x, y), x);
        slope_is_right("sqrt", |x| (x * x + y).sqrt(), x);
        slope_is_right("abs", |x| x.abs() * x, x);
        slope_is_right("min", |x| (x * x).min(x), x);
        slope_is_right("max", |x| (x * x).max(x), x);
        slope_is_right("sin", |x| sin_cos(x).0, x);
        slope_is_right("cos", |x| sin_cos(x).1, x);
        slope_is_right("horner", |x| horner(x, &[1.0, -0.5, 0.25, 0.1]), x);
        let mut sum = Dual::new(x, 1.0);
        sum += y;
        sum -= Dual::new(0.0, 0.25);
        assert_eq!(sum.slope, 0.75);
    }
    let (sin, cos) = sin_cos(Dual::new(0.8, 1.0));
    assert!((sin.slope - 0.8_f64.cos()).abs() < 1e-15 && (cos.slope + 0.8_f64.sin()).abs() < 1e-15);
    assert_eq!(Dual::new(2.6, 1.0).round(), Dual::new(3.0, 0.0));
}

/// `T^-1 dT` of `T = exp(theta + t delta)` at t = 0 is `dexp_(-theta) delta`: duals differentiate the kernel exactly.
#[test]
fn exponential_of_duals_moves_with_the_body_twist() {
    let mut random = Random::new(5);
    for _ in 0..50 {
        let theta: [f64; 6] = std::array::from_fn(|_| random.between(-1.5, 1.5));
        let twist: [f64; 6] = std::array::from_fn(|_| random.between(-1.0, 1.0));
        let of = |x: [f64; 6]| Vector6::from_array(x);
        let delta = dexp_inverse_negative(DexpInverse::Closed, of(theta), of(twist)).to_array();
        let moving: Pose<Dual> = exp_se3(Vector6::from_array(std::array::from_fn(|i| Dual::new(theta[i], delta[i]))));
        let value = exp_se3(of(theta));
        let slope = moving.rotation.0.map(|row| row.map(|x| x.slope));
        let omega = value.rotation.transposed().times(&Matrix3(slope)).0;
        let v = value.rotation.apply_transposed(Vector3(moving.position.0.map(|x| x.slope))).0;
        let seen = [v[0], v[1], v[2], omega[2][1], omega[0][2], omega[1][0]];
        for k in 0..6 {
            assert!((seen[k] - twist[k]).abs() < 1e-13, "{seen:?} {twist:?}");
        }
    }
}

#[test]
fn accelerations_of_duals_are_their_derivatives() {
    let scene =
        random_scene(11, Options { links: Some(4), branching: Some(true), fixed: Some(false), ..Options::default() });
    let system = compile(&scene).system;
    let state = random_state(11, &scene);
    let mut random = Random::new(9);
    let direction: Vec<f64> = (0..6 + 2 * JOINTS).map(|_| random.between(-1.0, 1.0)).collect();
    fn run<L: Lane<Real = f64>>(system: &System<Shared<f64>>, x: impl Fn(usize) -> L) -> Vec<L> {
        let (q, qd) = (std::array::from_fn(|i| x(6 + i)), std::array::from_fn(|i| x(6 + JOINTS + i)));
        let twist = Vector6::from_array(std::array::from_fn(&x));
        let gravity = Vector3([0.3, -2.0, -9.0].map(L::c));
        let instant = Instant {
            is_start: true,
            gravity,
            twist,
            q: &q,
            qd: &qd,
            wrench: &Vector6::zero(),
            fixed_rate: None,
            time: L::zero(),
            elapsed: L::zero(),
        };
        let (mut twist_rate, mut qdd) = (Vector6::zero(), [L::zero(); JOINTS]);
        accelerations::<_, _, _, false>(
            system,
            &instant,
            &ArmLoads::none(),
            &mut Scratch::new(),
            &mut twist_rate,
            &mut qdd,
        );
        twist_rate.to_array().into_iter().chain(qdd).collect()
    }
    let place: Vec<f64> = state.twist.iter().chain(&state.q).chain(&state.qd).copied().collect();
    let values = |t: f64| run::<f64>(&system, |i| place[i] + t * direction[i]);
    let h = 1e-4;
    let duals = run::<Dual>(&system, |i| Dual::new(place[i], direction[i]));
    let (ahead, behind, here) = (values(h), values(-h), values(0.0));
    let scale = duals.iter().fold(1.0_f64, |s, d| s.max(d.slope.abs()));
    for k in 0..10 {
        let expected = (ahead[k] - behind[k]) / (2.0 * h);
        assert!((duals[k].slope - expected).abs() < 1e-6 * scale, "{k}: {} {expected}", duals[k].slope);
        assert!((duals[k].value - here[k]).abs() < 1e-11 * scale);
    }
}

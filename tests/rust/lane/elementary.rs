//! Logarithms, angles and inverse square roots against the standard library, which is right to half an epsilon or so.

use crate::lane::lanes;
use crate::random_scene::Random;
use uvms_gym::lane::{Isa, Kernel, Lane, Real, atan2, inverse_sqrt, ln, ln_1p, sin_cos, sin_cos_beyond, sin_cos_near};

/// `ln(a)`, `ln(1 + a)`, `atan2(b, a)` and `1 / sqrt(|a|)` of pairs; sine and cosine of `b` from sine and cosine of `a`.
struct Functions<'a, T> {
    pairs: &'a [[T; 2]],
    out: Vec<[T; 6]>,
}

impl<T: Real> Kernel<T> for Functions<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        for pairs in self.pairs.chunks_exact(L::LANES) {
            let [a, b] = [0, 1].map(|k| L::load(&pairs.iter().map(|pair| pair[k]).collect::<Vec<_>>()));
            let (sin, cos) = sin_cos(a);
            let start = [a, sin, cos];
            let [sin, cos] = sin_cos_beyond(b, start, sin_cos_near(b, start).0);
            let results = [ln(a), ln_1p(a), atan2(b, a), inverse_sqrt(a.abs()), sin, cos].map(lanes);
            self.out.extend((0..L::LANES).map(|k| [0, 1, 2, 3, 4, 5].map(|f| results[f][k])));
        }
    }
}

fn functions<T: Real>(isa: Isa, pairs: &[[f64; 2]]) -> Vec<[f64; 6]> {
    assert_eq!(pairs.len() % 16, 0);
    let pairs: Vec<[T; 2]> = pairs.iter().map(|pair| pair.map(T::from_f64)).collect();
    let mut kernel = Functions { pairs: &pairs, out: Vec::new() };
    T::dispatch(isa, &mut kernel);
    kernel.out.iter().map(|row| row.map(T::to_f64)).collect()
}

/// Pairs of all magnitudes that the type holds well; half of them near 1, where logarithms cancel, and near each other.
fn pairs<T: Real>() -> Vec<[f64; 2]> {
    let maximum = if T::SINGLE { 30.0 } else { 280.0 };
    let mut random = Random::new(5);
    let mut number = |near: bool| {
        let x = if near { random.between(0.4, 2.5) } else { 10.0_f64.powf(random.between(-maximum, maximum)) };
        T::from_f64(x * random.between(-1.0, 1.0).signum()).to_f64()
    };
    (0..40_000).map(|i| [number(i % 2 == 0), number(i % 4 < 2)]).collect()
}

/// Maximum error of each function, by epsilons of the result.
fn worst<T: Real>(isa: Isa) -> [f64; 4] {
    let mut worst = [0.0_f64; 4];
    let minimum = if T::SINGLE { f64::from(f32::MIN_POSITIVE) } else { f64::MIN_POSITIVE };
    let pairs = pairs::<T>();
    for ([a, b], got) in pairs.iter().zip(functions::<T>(isa, &pairs)) {
        let expected = [a.ln(), a.ln_1p(), b.atan2(*a), a.abs().sqrt().recip()];
        for f in 0..4 {
            if expected[f].is_nan() {
                assert!(got[f].is_nan(), "{f}({a}, {b}) = {}", got[f]);
            } else if expected[f].abs() > minimum {
                let error = (got[f] - expected[f]).abs() / (T::EPSILON * expected[f].abs());
                assert!(error.is_finite(), "{f}({a}, {b}) = {}, not {}", got[f], expected[f]);
                worst[f] = worst[f].max(error);
            }
        }
    }
    worst
}

#[test]
fn val_elementary_functions_are_those_of_the_standard_library() {
    for isa in Isa::available() {
        for (name, worst) in [("f64", worst::<f64>(isa)), ("f32", worst::<f32>(isa))] {
            println!("{name} {}: {worst:.2?} epsilons of the result", isa.name());
            assert!(worst.iter().all(|error| *error < 1.5), "{name} {}: {worst:?}", isa.name());
        }
    }
}

/// Angles, and others at distances of all magnitudes from them: within reach, at its border, and beyond.
fn angles_and_others<T: Real>() -> Vec<[f64; 2]> {
    let mut random = Random::new(9);
    let mut pair = |k: usize| {
        let start = T::from_f64(random.between(-100.0, 100.0));
        let distance = match k % 4 {
            0 => 10.0_f64.powf(random.between(-12.0, -1.2)),
            1 => random.between(0.0, 0.0625),
            2 => 0.0625 + random.between(-1e-3, 1e-3),
            _ => random.between(0.0, 10.0),
        };
        [start, start + T::from_f64(random.between(-1.0, 1.0).signum() * distance)].map(T::to_f64)
    };
    (0..40_000).map(&mut pair).collect()
}

fn sines_from_near_by<T: Real>(bar: f64) {
    let pairs = angles_and_others::<T>();
    let near = |isa| functions::<T>(isa, &pairs).into_iter().map(|[.., sin, cos]| [sin, cos]).collect::<Vec<_>>();
    let expected = near(Isa::Fma);
    for isa in Isa::available() {
        let got = near(isa);
        let mut worst = 0.0_f64;
        for ([_, x], [sin, cos]) in pairs.iter().zip(&got) {
            let (s, c) = x.sin_cos();
            let error = (sin - s).abs().max((cos - c).abs()) / T::EPSILON;
            assert!(error.is_finite());
            worst = worst.max(error);
        }
        println!("{}: {worst:.2} epsilons of one", isa.name());
        assert!(worst < bar, "{}: {worst}", isa.name());
        // Whether a lane's neighbours are far makes no difference to it.
        if isa != Isa::Plain {
            assert!(got == expected, "{}", isa.name());
        }
    }
}

#[test]
fn val_sine_and_cosine_from_near_by_are_those_of_the_standard_library() {
    sines_from_near_by::<f64>(1.5);
    sines_from_near_by::<f32>(1.5);
}

#[test]
fn what_is_not_positive_and_normal_has_the_limits_logarithm() {
    let (infinity, nan) = (f64::INFINITY, f64::NAN);
    for isa in Isa::available() {
        let cases = [0.0, -0.0, 1e-310, 1.0, infinity, -infinity, nan, -1.0, -2.0, 2.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0];
        let got = functions::<f64>(isa, &cases.map(|x| [x, 0.0]));
        let expected = [-infinity, -infinity, -infinity, 0.0, infinity, nan, nan, nan, nan];
        let expected_1p = [0.0, -0.0, 1e-310, std::f64::consts::LN_2, infinity, nan, nan, -infinity, nan];
        for i in 0..expected.len() {
            for (got, expected) in [(got[i][0], expected[i]), (got[i][1], expected_1p[i])] {
                assert!(got == expected || got.is_nan() && expected.is_nan(), "{}: {got} {expected}", cases[i]);
            }
        }
    }
}

#[test]
fn angles_go_round() {
    let pairs = [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [-1.0, 1.0], [-1.0, 0.0], [-1.0, -1.0], [0.0, -2.0], [3.0, -3.0]];
    let eighths = [0.0, 1.0, 2.0, 3.0, 4.0, -3.0, -2.0, -1.0];
    for (pair, expected) in pairs.into_iter().zip(eighths) {
        assert_eq!(atan2(pair[1], pair[0]), expected * std::f64::consts::FRAC_PI_4);
        assert_eq!(atan2(pair[1] as f32, pair[0] as f32), expected as f32 * std::f32::consts::FRAC_PI_4);
    }
    assert_eq!(atan2(0.0, 0.0), 0.0);
    assert!(atan2(f64::NAN, 1.0).is_nan() && atan2(1.0, f64::NAN).is_nan());
}

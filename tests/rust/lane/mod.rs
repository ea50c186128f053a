//! Lanes: the same bits whatever the width, and elementary functions against the standard library.

mod dual;
mod elementary;
mod steps;
mod transpose;

use crate::random_scene::{Options, Random, random_scene};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::aba::{ArmLoads, Instant, Scratch, accelerations};
use uvms_gym::lane::{Isa, Kernel, Lane, Real, Shared, atan2, horner, ln, ln_1p, sin_cos};
use uvms_gym::lie::{Vector3, Vector6};
use uvms_gym::system::{JOINTS, System, compile};

/// Every operation of a lane on triples of numbers.
struct Operations<'a, T> {
    a: &'a [T],
    b: &'a [T],
    c: &'a [T],
    /// Name and results of each operation.
    out: Vec<(&'static str, Vec<T>)>,
}

/// Numbers of all lanes.
fn lanes<L: Lane>(x: L) -> Vec<L::Real> {
    let mut lanes = vec![L::Real::default(); L::LANES];
    x.store(&mut lanes);
    lanes
}

impl<T: Real> Kernel<T> for Operations<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        for at in (0..self.a.len()).step_by(L::LANES) {
            let (a, b, c) = (L::load(&self.a[at..]), L::load(&self.b[at..]), L::load(&self.c[at..]));
            let (sin, cos) = sin_cos(a);
            let mut assigned = a;
            assigned += b;
            assigned -= c;
            let (mantissa, exponent) = a.split();
            let mut single = [0.0_f32; 16];
            a.store_single(&mut single);
            let results = [
                ("add", a + b),
                ("sub", a - b),
                ("mul", a * b),
                ("div", a / b),
                ("neg", -a),
                ("mul_add", a.mul_add(b, c)),
                ("neg_mul_add", a.neg_mul_add(b, c)),
                ("sqrt", a.sqrt()),
                ("abs", a.abs()),
                ("round", a.round()),
                ("min", a.min(b)),
                ("max", a.max(b)),
                ("select", L::select(a.lt(b), c, L::c(0.5))),
                ("sin", sin),
                ("cos", cos),
                ("horner", horner(a, &[0.3, -1.2, 0.7])),
                ("assign", assigned),
                ("mantissa", mantissa),
                ("exponent", exponent),
                ("ln", ln(a)),
                ("ln_1p", ln_1p(a)),
                ("atan2", atan2(a, b)),
                ("single", L::load_single(&single)),
                ("both", L::select(L::and(a.lt(b), c.lt(b)), c, a)),
            ];
            self.out.resize(results.len(), ("", Vec::new()));
            for ((name, row), (operation, x)) in self.out.iter_mut().zip(results) {
                *name = operation;
                row.extend(lanes(x));
                let mut double = [0.0; 16];
                x.store_double(&mut double);
                assert!((0..L::LANES).all(|k| same(T::from_f64(double[k]), row[at + k])));
            }
        }
    }
}

fn operations<T: Real>(isa: Isa, columns: &[Vec<T>; 3]) -> Vec<(&'static str, Vec<T>)> {
    let [a, b, c] = columns;
    let mut kernel = Operations { a, b, c, out: Vec::new() };
    T::dispatch(isa, &mut kernel);
    kernel.out
}

/// Numbers of all kinds, in three columns of the same length, a multiple of every width.
fn columns<T: Real>() -> [Vec<T>; 3] {
    let mut random = Random::new(1);
    let special =
        [0.0, -0.0, 1.0, -1.0, 0.5, 1.5, 2.5, -2.5, f64::NAN, f64::INFINITY, -f64::INFINITY, 1e-310, 1e-40, 4e9];
    let mut triples: Vec<[f64; 3]> = Vec::new();
    for a in special {
        for b in special {
            triples.push([a, b, 0.25]);
        }
    }
    while triples.len() < 4096 {
        let mut number = || random.between(-1.0, 1.0) * 10.0_f64.powf(random.between(-8.0, 5.0));
        triples.push([number(), number(), number()]);
    }
    [0, 1, 2].map(|k| triples.iter().map(|t| T::from_f64(t[k])).collect())
}

/// The same number, with its sign of zero; all NaN alike.
fn same<T: Real>(a: T, b: T) -> bool {
    let (a, b) = (a.to_f64(), b.to_f64());
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

fn fused() -> impl Iterator<Item = Isa> {
    Isa::available().filter(|&isa| isa != Isa::Plain)
}

fn widths_agree<T: Real>() {
    let columns = columns::<T>();
    let Some(scalar) = fused().last() else { return };
    let scalar_results = operations(scalar, &columns);
    for isa in fused() {
        let results = operations(isa, &columns);
        for ((name, row), (_, expected)) in results.iter().zip(&scalar_results) {
            for i in 0..row.len() {
                let [a, b, c] = [0, 1, 2].map(|k| columns[k][i]);
                assert!(same(row[i], expected[i]), "{name}({a:?}, {b:?}, {c:?}): {:?} {:?}", row[i], expected[i]);
            }
        }
    }
}

#[test]
fn all_fused_widths_give_the_same_bits() {
    assert!(fused().count() > 0 || cfg!(not(target_arch = "x86_64")), "no machine with FMA: nothing tested");
    widths_agree::<f64>();
    widths_agree::<f32>();
}

/// Rounding twice where the others round once makes a difference, but a small one.
fn unfused_is_near<T: Real>() {
    let columns = columns::<T>();
    let Some(isa) = fused().next() else { return };
    let (fused, plain) = (operations(isa, &columns), operations(Isa::Plain, &columns));
    let mut different = 0;
    for ((name, fused), (_, plain)) in fused.iter().zip(&plain) {
        for i in 0..fused.len() {
            let [a, b, c] = [0, 1, 2].map(|k| columns[k][i].to_f64());
            // Rounding of the product before the sum.
            let scale = match *name {
                "mul_add" | "neg_mul_add" => (a * b).abs() + c.abs(),
                "sin" | "cos" if a.abs() > T::EPSILON.powf(-0.55) => f64::INFINITY,
                "sin" | "cos" => 1.0,
                "ln" => a.abs().ln().abs(),
                "ln_1p" => (1.0 + a).abs().ln().abs().max(a.abs().min(1.0)) * 4.0,
                "atan2" => 4.0,
                "horner" => 1.0 + 1.2 * a.abs() + 0.7 * a * a,
                _ => 0.0,
            };
            let (x, y) = (fused[i].to_f64(), plain[i].to_f64());
            different += usize::from(x != y && !x.is_nan());
            let near = (x - y).abs() <= 2.0 * T::EPSILON * scale;
            assert!(near || same(fused[i], plain[i]) || !scale.is_finite(), "{name}({a}, {b}, {c}): {x} {y}");
        }
    }
    assert!(different > 0, "the plain lanes are not unfused");
}

#[test]
fn unfused_lanes_differ_by_rounding_alone() {
    unfused_is_near::<f64>();
    unfused_is_near::<f32>();
}

#[test]
fn operations_are_those_of_ieee() {
    let columns = columns::<f64>();
    let results = operations(Isa::available().next().unwrap(), &columns);
    for i in 0..columns[0].len() {
        let [a, b, c] = [0, 1, 2].map(|k| columns[k][i]);
        let selected = if a < b { c } else { 0.5 };
        let (smaller, greater) = (if a < b { a } else { b }, if b < a { a } else { b });
        let expected = [
            a + b,
            a - b,
            a * b,
            a / b,
            -a,
            a.mul_add(b, c),
            (-a).mul_add(b, c),
            a.sqrt(),
            a.abs(),
            a.round_ties_even(),
            smaller,
            greater,
            selected,
        ];
        let fused = Isa::available().next() != Some(Isa::Plain);
        for (k, expected) in expected.into_iter().enumerate().filter(|(k, _)| fused || !(5..7).contains(k)) {
            let (name, got) = (results[k].0, results[k].1[i]);
            assert!(same(got, expected), "{name}({a}, {b}, {c}): {got} {expected}");
        }
    }
}

#[test]
fn min_and_max_hand_on_the_second_where_either_is_nan() {
    fn check<L: Lane<Real = f64>>() {
        let first = |x: L| lanes(x)[0];
        let (nan, one) = (L::c(f64::NAN), L::c(1.0));
        assert_eq!(first(nan.min(one)), 1.0);
        assert_eq!(first(nan.max(one)), 1.0);
        assert!(first(one.min(nan)).is_nan());
        assert!(first(one.max(nan)).is_nan());
        assert!(!L::any(nan.lt(one)) && !L::any(one.lt(nan)) && !L::any(nan.lt(nan)));
        assert!(L::any(one.lt(L::c(2.0))) && !L::any(one.lt(one)));
    }
    struct Check;
    impl Kernel<f64> for Check {
        #[inline(always)]
        fn run<L: Lane<Real = f64>>(&mut self) {
            check::<L>();
        }
    }
    for isa in Isa::available() {
        f64::dispatch(isa, &mut Check);
    }
}

#[test]
fn any_and_bits_see_each_lane() {
    struct Alone(usize);
    impl Kernel<f32> for Alone {
        #[inline(always)]
        fn run<L: Lane<Real = f32>>(&mut self) {
            for k in 0..L::LANES {
                let mut one = [0.0_f32; 16];
                one[k] = 1.0;
                assert!(L::any(L::c(0.5).lt(L::load(&one))), "lane {k} of {}", L::LANES);
                self.0 += 1;
            }
        }
    }
    let mut lanes = Alone(0);
    for isa in Isa::available() {
        f32::dispatch(isa, &mut lanes);
    }
    assert!(lanes.0 >= Isa::available().count());
}

/// Angles: all magnitudes up to `maximum`, and next to every kind of quadrant border.
fn angles(maximum: f64) -> Vec<f64> {
    let mut random = Random::new(2);
    let mut angles: Vec<f64> = (0..40_000)
        .map(|_| random.between(-1.0, 1.0).signum() * 10.0_f64.powf(random.between(-12.0, maximum.log10())))
        .collect();
    let borders = (maximum / std::f64::consts::FRAC_PI_4) as i64;
    for i in 0..20_000 {
        let k = if i < 2000 { i } else { (random.bits() % borders as u64) as i64 };
        let border = k as f64 * std::f64::consts::FRAC_PI_4;
        angles.extend([border, border.next_up(), -border, -border.next_down(), border + 1e-9]);
    }
    angles.truncate(angles.len() / 16 * 16);
    angles
}

/// Maximum errors of sine and cosine, relative to rounding of the result (first) and of one (second).
fn sin_cos_error<T: Real>(isa: Isa, maximum: f64) -> [f64; 2] {
    let a: Vec<T> = angles(maximum).into_iter().map(T::from_f64).collect();
    let columns = [a.clone(), a.clone(), a.clone()];
    let results = operations(isa, &columns);
    let mut worst = [0.0_f64; 2];
    for (i, x) in a.iter().enumerate() {
        let (sin, cos) = x.to_f64().sin_cos();
        for (got, expected) in [(results[13].1[i], sin), (results[14].1[i], cos)] {
            let error = (got.to_f64() - expected).abs() / T::EPSILON;
            assert!(error.is_finite());
            worst[1] = worst[1].max(error);
            if expected != 0.0 {
                worst[0] = worst[0].max(error / expected.abs());
            }
        }
    }
    worst
}

#[test]
fn val_sine_and_cosine_are_those_of_the_standard_library() {
    for isa in Isa::available() {
        let [relative, absolute] = sin_cos_error::<f64>(isa, 1e6);
        println!("f64 {}: {relative} epsilons of the result, {absolute} of one", isa.name());
        assert!(relative < 1.5 && absolute <= 1.0, "{}: {relative} {absolute}", isa.name());
        let [relative, absolute] = sin_cos_error::<f32>(isa, 1e4);
        println!("f32 {}: {relative} epsilons of the result, {absolute} of one", isa.name());
        // Next to a multiple of pi the reduced angle keeps fewer digits, of a result that is next to nothing.
        assert!(absolute <= 1.0, "{}: {absolute}", isa.name());
    }
}

#[test]
fn sine_and_cosine_of_what_is_no_angle_are_nan() {
    for x in [f64::NAN, f64::INFINITY, -f64::INFINITY] {
        let (sin, cos) = sin_cos(x);
        assert!(sin.is_nan() && cos.is_nan());
    }
    assert_eq!(sin_cos(0.0_f64), (0.0, 1.0));
}

/// Accelerations of several instances of one system, each with its own state.
struct Dynamics<'a, T> {
    system: &'a System<Shared<T>>,
    /// Per instance: gravity (3), twist (6), q, qd, wrench (6).
    numbers: &'a [Vec<T>],
    out: Vec<Vec<T>>,
}

impl<T: Real> Kernel<T> for Dynamics<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        let width = 6 + JOINTS;
        self.out = vec![vec![T::default(); width]; self.numbers.len()];
        let mut scratch = Scratch::<L>::new();
        for at in (0..self.numbers.len()).step_by(L::LANES) {
            let number = |k: usize| {
                let column: Vec<T> = self.numbers[at..at + L::LANES].iter().map(|row| row[k]).collect();
                L::load(&column)
            };
            let six = |k: usize| Vector6::from_array([0, 1, 2, 3, 4, 5].map(|i| number(k + i)));
            let joints = |k: usize| std::array::from_fn(|i| number(k + i));
            let (q, qd) = (joints(9), joints(9 + JOINTS));
            let instant = Instant {
                is_start: true,
                gravity: Vector3([number(0), number(1), number(2)]),
                twist: six(3),
                q: &q,
                qd: &qd,
                wrench: &six(9 + 2 * JOINTS),
                fixed_rate: if self.system.fixed { Some(Vector3::zero()) } else { None },
                time: L::zero(),
                elapsed: L::zero(),
            };
            let (mut twist_rate, mut qdd) = (Vector6::zero(), [L::zero(); JOINTS]);
            accelerations::<_, _, _, false>(
                self.system,
                &instant,
                &ArmLoads::none(),
                &mut scratch,
                &mut twist_rate,
                &mut qdd,
            );
            for (k, x) in twist_rate.to_array().into_iter().chain(qdd).enumerate() {
                for (i, x) in lanes(x).into_iter().enumerate() {
                    self.out[at + i][k] = x;
                }
            }
        }
    }
}

fn numbers<T: Real>(count: u64) -> Vec<Vec<T>> {
    let instance = |seed| {
        let mut random = Random::new(seed);
        (0..15 + 2 * JOINTS).map(|_| T::from_f64(random.between(-1.0, 1.0))).collect()
    };
    (0..count).map(instance).collect()
}

fn dynamics_agree<T: Real>(scene: &Scene) {
    let system = compile(scene).system.map(|Shared(x)| Shared(T::from_f64(x)));
    let numbers = numbers::<T>(32);
    let run = |isa| {
        let mut kernel = Dynamics { system: &system, numbers: &numbers, out: Vec::new() };
        T::dispatch(isa, &mut kernel);
        kernel.out
    };
    let Some(scalar) = fused().last() else { return };
    let expected = run(scalar);
    for isa in fused() {
        let got = run(isa);
        let different = got.iter().flatten().zip(expected.iter().flatten()).filter(|(a, b)| !same(**a, **b)).count();
        assert_eq!(different, 0, "{} differs from {}", isa.name(), scalar.name());
    }
    let scale = expected.iter().flatten().fold(0.0_f64, |s, x| s.max(x.to_f64().abs()));
    for (x, y) in run(Isa::Plain).iter().flatten().zip(expected.iter().flatten()) {
        assert!((x.to_f64() - y.to_f64()).abs() < 1e4 * T::EPSILON * scale, "{x:?} {y:?}");
    }
}

#[test]
fn accelerations_have_the_same_bits_on_all_fused_widths() {
    let options = Options { links: Some(5), branching: Some(true), ..Options::default() };
    for scene in [Scene::shipped("petasus-pum").unwrap(), random_scene(3, options)] {
        dynamics_agree::<f64>(&scene);
        dynamics_agree::<f32>(&scene);
    }
}

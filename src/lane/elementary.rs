//! Elementary functions in lanes: the same polynomials, hence the same bits, at every width.

use super::number::{Lane, Real};

/// `c[0] + c[1] x + c[2] x^2 + ...`
#[inline(always)]
pub fn horner<L: Lane, const N: usize>(x: L, c: &[f64; N]) -> L {
    let mut sum = L::c(c[N - 1]);
    unroll!(k < N - 1 => {
        sum = sum.mul_add(x, L::c(c[N - 2 - k]));
    });
    sum
}

/// First `N` coefficients of a series.
#[inline(always)]
pub const fn first<const N: usize>(c: &[f64]) -> &[f64; N] {
    match c.first_chunk() {
        Some(first) => first,
        None => panic!("fewer coefficients than asked for"),
    }
}

/// pi/2 in three parts: the first two have few enough digits that their multiples up to 2^20 are exact.
const HALF_PI: [f64; 3] = [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21];
const HALF_PI_SINGLE: [f64; 3] = [1.570_312_5, 4.837_512_969_970_703e-4, 7.549_789_948_768_648e-8];

/// Minimax coefficients on [-pi/4, pi/4] of (sin x / x - 1) / x^2 in x^2 (from fdlibm).
const SIN: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];
/// Minimax coefficients on [-pi/4, pi/4] of (cos x - 1 + x^2/2) / x^4 in x^2 (from fdlibm).
const COS: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];

/// Sine and cosine; full accuracy up to |x| = 1e6 (single precision: 1e4), beyond any joint angle.
#[inline(always)]
pub fn sin_cos<L: Lane>(x: L) -> (L, L) {
    let half_pi = if L::Real::SINGLE { HALF_PI_SINGLE } else { HALF_PI };
    let k = (x * L::c(std::f64::consts::FRAC_2_PI)).round();
    let mut r = k.neg_mul_add(L::c(half_pi[0]), x);
    r = k.neg_mul_add(L::c(half_pi[1]), r);
    r = k.neg_mul_add(L::c(half_pi[2]), r);

    let z = r * r;
    let (sin, cos) = if const { L::Real::SINGLE } {
        (horner(z, first::<4>(&SIN)), horner(z, first::<4>(&COS)))
    } else {
        (horner(z, &SIN), horner(z, &COS))
    };
    let sin = (r * z).mul_add(sin, r);
    let cos = (z * z).mul_add(cos, z.mul_add(L::c(-0.5), L::c(1.0)));

    // Quadrant k mod 4, in {-2, -1, 0, 1, 2}.
    let quadrant = (k * L::c(0.25)).round().mul_add(L::c(-4.0), k);
    let odd = (quadrant.abs() - L::c(1.0)).abs().lt(L::c(0.5));
    let negative_sin = L::c(1.0).lt((quadrant - L::c(0.5)).abs());
    let negative_cos = L::c(1.0).lt((quadrant + L::c(0.5)).abs());
    let (s, c) = (L::select(odd, cos, sin), L::select(odd, sin, cos));
    (L::select(negative_sin, -s, s), L::select(negative_cos, -c, c))
}

/// Maximum distance for [`sin_cos_near`].
const NEAR: f64 = 1.0 / 16.0;
/// Taylor coefficients of (sin d / d - 1) / d^2 and of (cos d - 1) / d^2 in d^2: good to rounding of 1 for |d| < [`NEAR`].
const SHORT_SIN: [f64; 3] = [-1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0];
const SHORT_COS: [f64; 4] = [-0.5, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40320.0];

/// Sine and cosine of x from sine and cosine of a nearby number, given as `[number, sine, cosine]`, by the addition theorem; and the
/// square of their distance, for [`is_far`].
#[inline(always)]
pub fn sin_cos_near<L: Lane>(x: L, [number, sin, cos]: [L; 3]) -> ([L; 2], L) {
    let d = x - number;
    let z = d * d;
    let (sine, less) = if const { L::Real::SINGLE } {
        (horner(z, first::<1>(&SHORT_SIN)), horner(z, first::<2>(&SHORT_COS)))
    } else {
        (horner(z, &SHORT_SIN), horner(z, &SHORT_COS))
    };
    let (sine, less) = ((z * d).mul_add(sine, d), z * less);
    ([cos.mul_add(sine, sin.mul_add(less, sin)), sin.neg_mul_add(sine, cos.mul_add(less, cos))], z)
}

/// True where the square of a distance is beyond the range of [`sin_cos_near`].
#[inline(always)]
pub fn is_far<L: Lane>(square: L) -> L::Mask {
    L::c(NEAR * NEAR).lt(square)
}

/// Results of [`sin_cos_near`], replaced by [`sin_cos`] in lanes where the numbers are too far apart.
#[inline(always)]
pub fn sin_cos_beyond<L: Lane>(x: L, [number, ..]: [L; 3], near: [L; 2]) -> [L; 2] {
    let (d, (sin, cos)) = (x - number, sin_cos(x));
    let far = is_far(d * d);
    [L::select(far, sin, near[0]), L::select(far, cos, near[1])]
}

/// Constant of the inverse square root estimate: half of the number's bits are subtracted from it.
pub(super) const INVERSE_SQRT: u64 = 0x5fe6_eb50_c7b5_37a9;
pub(super) const INVERSE_SQRT_SINGLE: u32 = 0x5f37_59df;
/// Minimax coefficients of `(1 - h)^(-1/2)` in h on the range of h after the estimate: relative error 8e-7 and 3e-5.
const FIRST: [f64; 4] =
    [0.999_999_242_040_421_8, 0.500_001_884_761_637_7, 0.376_288_248_797_190_8, 0.312_440_785_264_109_7];
const FIRST_SINGLE: [f64; 3] = [1.000_000_840_335_217_7, 0.501_104_365_996_356, 0.374_976_854_676_734_5];

/// `1 / sqrt(x)` of a positive normal number, to two epsilons. By multiplications only: square root and division of 8 numbers of
/// f64 take four times as long and block the divider for other operations.
#[inline(always)]
pub fn inverse_sqrt<L: Lane>(x: L) -> L {
    // With h = 1 - x y^2 the result is y (1 - h)^(-1/2); for small h the terms 1 + h/2 + 3 h^2/8 suffice.
    let one = L::c(1.0);
    let y = x.inverse_sqrt_estimate();
    let h = (x * y).neg_mul_add(y, one);
    let y = y * if const { L::Real::SINGLE } { horner(h, &FIRST_SINGLE) } else { horner(h, &FIRST) };
    let h = (x * y).neg_mul_add(y, one);
    let half = if L::Real::SINGLE { L::c(0.5) } else { h.mul_add(L::c(0.375), L::c(0.5)) };
    (y * h).mul_add(half, y)
}

/// Range of the exponents of [`exp`], in powers of 2.
const EXPONENT: f64 = 31.0;

/// `e^x`, to a few units in the last place, for |x| up to 21; beyond, as there.
#[inline(always)]
pub fn exp<L: Lane>(x: L) -> L {
    let ([high, low], terms) = if L::Real::SINGLE { (LN_2_SINGLE, 8) } else { (LN_2, 14) };
    let k = (x * L::c(std::f64::consts::LOG2_E)).round();
    let k = k.min(L::c(EXPONENT)).max(L::c(-EXPONENT));
    let r = k.neg_mul_add(L::c(low), k.neg_mul_add(L::c(high), x));
    // e^r by its series: |r| <= ln(2) / 2.
    let r = r.min(L::c(0.35)).max(L::c(-0.35));
    let (mut y, mut term) = (L::c(1.0), terms);
    while term > 0 {
        y = y.mul_add(r * L::c(1.0 / f64::from(term)), L::c(1.0));
        term -= 1;
    }
    // Times 2^k, bit by bit.
    let (down, mut rest) = (k.lt(L::zero()), k.abs());
    for [bit, power] in [[16.0, 65536.0], [8.0, 256.0], [4.0, 16.0], [2.0, 4.0], [1.0, 2.0]] {
        let has = L::c(bit - 0.5).lt(rest);
        y = L::select(has, y * L::select(down, L::c(1.0 / power), L::c(power)), y);
        rest = L::select(has, rest - L::c(bit), rest);
    }
    y
}

/// tanh x / x as a ratio of polynomials in x^2: minimax on |x| <= 9.01, where the relative error is 2.1e-8.
const TANH: [[f64; 5]; 2] = [
    [0.999_999_979, 0.133_803_749, 3.494_814_94e-3, 2.059_633_42e-5, 1.333_692_44e-8],
    [1.0, 0.467_136_904, 2.587_404_18e-2, 3.284_369_43e-4, 7.769_315_76e-7],
];

/// Hyperbolic tangent in single precision, to 6 units in the last place; never beyond -1 and 1.
#[inline(always)]
pub fn tanh<L: Lane<Real = f32>>(x: L) -> L {
    let x = x.min(L::c(9.01)).max(L::c(-9.01));
    let z = x * x;
    let y = x * horner(z, &TANH[0]) / horner(z, &TANH[1]);
    y.min(L::c(1.0)).max(L::c(-1.0))
}

/// ln 2 in two parts; multiples of the first by exponents are exact.
const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];
const LN_2_SINGLE: [f64; 2] = [6.931_381_225_585_938e-1, 9.058_000_614_453_107e-6];
/// Minimax coefficients of (ln((1 + s) / (1 - s)) - 2 s) / s^3 in s^2, for s up to 0.1716 (from fdlibm).
const LN: [f64; 7] = [
    6.666_666_666_666_735e-1,
    3.999_999_999_940_942e-1,
    2.857_142_874_366_239e-1,
    2.222_219_843_214_978_4e-1,
    1.818_357_216_161_805e-1,
    1.531_383_769_920_937_3e-1,
    1.479_819_860_511_658_6e-1,
];
const LN_SINGLE: [f64; 4] =
    [6.666_666_269_302_368e-1, 4.000_097_215_175_629e-1, 2.849_878_668_785_095e-1, 2.427_907_884_120_941_2e-1];

/// `ln(2^k (1 + f)) + c` for `1 + f` in [sqrt(2)/2, sqrt(2)] and a small correction c.
#[inline(always)]
fn ln_of_parts<L: Lane>(k: L, f: L, c: L) -> L {
    let ln_2 = if L::Real::SINGLE { LN_2_SINGLE } else { LN_2 };
    let s = f / (L::c(2.0) + f);
    let z = s * s;
    let half_square = (f * f) * L::c(0.5);
    // ln(1 + f) = f - (f^2 / 2 - s (f^2 / 2 + R))
    let r = if const { L::Real::SINGLE } { horner(z, &LN_SINGLE) } else { horner(z, &LN) };
    let bracket = half_square + z * r;
    let low = k.mul_add(L::c(ln_2[1]), c);
    k.mul_add(L::c(ln_2[0]), f - (half_square - s.mul_add(bracket, low)))
}

/// Exponent, and mantissa minus 1, with the mantissa in [sqrt(2)/2, sqrt(2)].
#[inline(always)]
fn balanced<L: Lane>(x: L) -> (L, L) {
    let (mantissa, exponent) = x.split();
    let great = L::c(std::f64::consts::SQRT_2).lt(mantissa);
    let k = L::select(great, exponent + L::c(1.0), exponent);
    (k, L::select(great, mantissa * L::c(0.5), mantissa) - L::c(1.0))
}

/// Natural logarithm of normal numbers; -infinity for 0 and subnormal numbers, NaN for negative ones.
#[inline(always)]
pub fn ln<L: Lane>(x: L) -> L {
    let (k, f) = balanced(x);
    beyond_finite(x, x, ln_of_parts(k, f, L::zero()))
}

/// `ln(1 + x)`, accurate for small x; -infinity for -1, NaN below.
#[inline(always)]
pub fn ln_1p<L: Lane>(x: L) -> L {
    let one = L::c(1.0);
    let u = one + x;
    let (k, f) = balanced(u);
    // Rounding error of 1 + x.
    let lost = L::select(x.lt(one), x - (u - one), one - (u - x));
    let near = k.abs().lt(L::c(0.5));
    let y = ln_of_parts(k, L::select(near, x, f), L::select(near, L::zero(), lost / u));
    beyond_finite(x, u, y)
}

/// `y = ln(u)`, or the limit where u is not a positive normal number; NaN where `x` is NaN.
#[inline(always)]
fn beyond_finite<L: Lane>(x: L, u: L, y: L) -> L {
    let infinity = L::c(f64::INFINITY);
    let minimum = if L::Real::SINGLE { f64::from(f32::MIN_POSITIVE) } else { f64::MIN_POSITIVE };
    // x + infinity is NaN for NaN, else infinity where x is not -infinity.
    let y = L::select(u.lt(infinity), y, x + infinity);
    let y = L::select(u.lt(L::c(minimum)), -infinity, y);
    L::select(u.lt(L::zero()), L::c(f64::NAN), y)
}

/// Minimax coefficients on [0, 7/16] of (1 - atan x / x) / x^2 in x^2 (from fdlibm).
const ATAN: [f64; 11] = [
    3.333_333_333_333_293e-1,
    -1.999_999_999_987_648_3e-1,
    1.428_571_427_250_346_6e-1,
    -1.111_111_040_546_235_6e-1,
    9.090_887_133_436_507e-2,
    -7.691_876_205_044_83e-2,
    6.661_073_137_387_531e-2,
    -5.833_570_133_790_573e-2,
    4.976_877_994_615_932_4e-2,
    -3.653_157_274_421_691_6e-2,
    1.628_582_011_536_578_2e-2,
];
const ATAN_SINGLE: [f64; 5] = [
    3.333_332_836_627_96e-1,
    -1.999_915_838_241_577e-1,
    1.425_363_570_451_736_5e-1,
    -1.064_801_737_666_13e-1,
    6.168_760_731_816_292e-2,
];
/// pi/4 in two parts; multiples of them by powers of two are multiples of pi.
const QUARTER_PI: [f64; 2] = [std::f64::consts::FRAC_PI_4, 3.061_616_997_868_383e-17];
const QUARTER_PI_SINGLE: [f64; 2] = [7.853_981_852_531_433e-1, -2.185_569_414_336_896e-8];
/// tan(pi/8)
const TAN_EIGHTH_PI: f64 = 0.414_213_562_373_095_05;

/// Angle of the point (x, y) from the x axis, in [-pi, pi], for finite x and y; 0 at the origin. Zeros have no sign.
#[inline(always)]
pub fn atan2<L: Lane>(y: L, x: L) -> L {
    let quarter = if L::Real::SINGLE { QUARTER_PI_SINGLE } else { QUARTER_PI };
    let (zero, one) = (L::zero(), L::c(1.0));
    let (rise, run) = (y.abs(), x.abs());
    // Angle minus 0, pi/4 or pi/2, so that its tangent is at most tan(pi/8).
    let diagonal = (run * L::c(TAN_EIGHTH_PI)).lt(rise);
    let steep = run.lt(rise * L::c(TAN_EIGHTH_PI));
    let (over, under) = (L::select(diagonal, rise - run, rise), L::select(diagonal, rise + run, run));
    let (over, under) = (L::select(steep, -run, over), L::select(steep, rise, under));
    let eighths = L::select(steep, L::c(2.0), L::select(diagonal, one, zero));
    // At the origin 0 / 1; NaN stays NaN.
    let t = over / L::select(zero.lt(under), under, under + one);
    let z = t * t;
    let series = if const { L::Real::SINGLE } { horner(z, &ATAN_SINGLE) } else { horner(z, &ATAN) };
    let bend = t * (z * series);
    let angle = eighths.mul_add(L::c(quarter[0]), eighths.mul_add(L::c(quarter[1]), -bend) + t);
    let half_turn = |part: usize| L::c(4.0 * quarter[part]);
    let angle = L::select(x.lt(zero), half_turn(0) - (angle - half_turn(1)), angle);
    L::select(y.lt(zero), -angle, angle)
}

//! Elementary functions in lanes: the same polynomial whatever the width, so the same bits.

use super::{Lane, Real};

/// `c[0] + c[1] x + c[2] x^2 + ...`
#[inline(always)]
pub fn horner<L: Lane>(x: L, c: &[f64]) -> L {
    let mut sum = L::c(c[c.len() - 1]);
    let mut i = c.len() - 1;
    while i > 0 {
        i -= 1;
        sum = sum.mul_add(x, L::c(c[i]));
    }
    sum
}

/// pi/2 in three parts: the first two have few enough digits that their multiples up to 2^20 are exact.
const HALF_PI: [f64; 3] = [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21];
const HALF_PI_SINGLE: [f64; 3] = [1.570_312_5, 4.837_512_969_970_703e-4, 7.549_789_948_768_648e-8];

/// Minimax coefficients on [-pi/4, pi/4] of (sin x / x - 1) / x^2 in x^2 (those of fdlibm).
const SIN: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];
/// Likewise of (cos x - 1 + x^2/2) / x^4.
const COS: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];

/// Sine and cosine; full accuracy up to |x| = 1e6 (single precision: 1e4), as joint angles have it.
#[inline(always)]
pub fn sin_cos<L: Lane>(x: L) -> (L, L) {
    let (half_pi, terms) = if L::Real::SINGLE { (HALF_PI_SINGLE, 4) } else { (HALF_PI, 6) };
    let k = (x * L::c(std::f64::consts::FRAC_2_PI)).round();
    let mut r = k.neg_mul_add(L::c(half_pi[0]), x);
    r = k.neg_mul_add(L::c(half_pi[1]), r);
    r = k.neg_mul_add(L::c(half_pi[2]), r);

    let z = r * r;
    let sin = (r * z).mul_add(horner(z, &SIN[..terms]), r);
    let cos = (z * z).mul_add(horner(z, &COS[..terms]), z.mul_add(L::c(-0.5), L::c(1.0)));

    // Quadrant k mod 4, in {-2, -1, 0, 1, 2}.
    let quadrant = (k * L::c(0.25)).round().mul_add(L::c(-4.0), k);
    let odd = (quadrant.abs() - L::c(1.0)).abs().lt(L::c(0.5));
    let negative_sin = L::c(1.0).lt((quadrant - L::c(0.5)).abs());
    let negative_cos = L::c(1.0).lt((quadrant + L::c(0.5)).abs());
    let (s, c) = (L::select(odd, cos, sin), L::select(odd, sin, cos));
    (L::select(negative_sin, -s, s), L::select(negative_cos, -c, c))
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

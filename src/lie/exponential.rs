//! Exponential map of SE(3) and the inverse of its differential.
//!
//! With `z = theta^2`, every coefficient is an entire function of z or a quotient of two, whose denominator has no zero below
//! `theta = 2 pi`:
//!
//! ```text
//! sin t / t                                   = S(z)
//! (1 - cos t) / t^2                           = C(z)
//! (t - sin t) / t^3                           = B(z)
//! dexp^-1: ad^2 coefficient                   = P(z) / (4 C(z)),  P = (8 C - 1 - 3 S) / z
//!          ad^4 coefficient                   = Q(z) / (4 C(z)),  Q = (4 C - 1 - S) / z^2
//! ```
//!
//! Their Taylor polynomials below are accurate to rounding for `t <= pi`; small angles need fewer terms. The ad^2 and ad^4 form of
//! dexp^-1 on SE(3) follows `[PC05]`. With `theta = (u, w)` and `V = (v, omega)`,
//! `ad^4 V = -z ad^2 V - 2 (w . u) (w x (w x omega), 0)`: so ad^4 reduces to a vector, and the coefficient of ad^2 is
//! `A = (P - z Q) / (4 C)`, the coefficient of SO(3), `(1 - (t / 2) cot(t / 2)) / t^2`, and its derivative
//! `A' = -Q / (4 C)`.

use super::{Pose, Vector3, Vector6, ad};
use crate::lane::{Lane, Real, first, horner, unroll};
use crate::lie::Matrix3;

/// Terms of each Taylor polynomial.
pub(super) const TERMS: usize = 15;

/// Factorials as f64, exact to rounding.
const fn factorial(n: usize) -> f64 {
    let mut product = 1.0;
    let mut k = 2;
    while k <= n {
        product *= k as f64;
        k += 1;
    }
    product
}

/// `(-1)^k`
const fn sign(k: usize) -> f64 {
    if k.is_multiple_of(2) { 1.0 } else { -1.0 }
}

/// Coefficients of S, C, B, P, Q in z.
pub(super) struct Series {
    pub s: [f64; TERMS],
    pub c: [f64; TERMS],
    pub b: [f64; TERMS],
    pub p: [f64; TERMS],
    pub q: [f64; TERMS],
}

pub(super) const SERIES: Series = {
    let zero = [0.0; TERMS];
    let mut series = Series { s: zero, c: zero, b: zero, p: zero, q: zero };
    let mut k = 0;
    while k < TERMS {
        series.s[k] = sign(k) / factorial(2 * k + 1);
        series.c[k] = sign(k) / factorial(2 * k + 2);
        series.b[k] = sign(k) / factorial(2 * k + 3);
        // One and two powers of z up; 8 C_j - 3 S_j = (8 - 3 (2j + 2)) sign / (2j + 2)!, and so on.
        let j = k + 1;
        series.p[k] = sign(j) * (8.0 - 3.0 * (2 * j + 2) as f64) / factorial(2 * j + 2);
        let j = k + 2;
        series.q[k] = sign(j) * (4.0 - (2 * j + 2) as f64) / factorial(2 * j + 2);
        k += 1;
    }
    series
};

/// Taylor coefficients of A and A' in z, by Bernoulli's numbers: `|B_2k| / (2k)!`, k from 1 on.
const BERNOULLI: [f64; 5] = [1.0 / 12.0, 1.0 / 720.0, 1.0 / 30240.0, 1.0 / 1_209_600.0, 1.0 / 47_900_160.0];
pub(super) const BERNOULLI_SLOPE: [f64; 4] = [BERNOULLI[1], 2.0 * BERNOULLI[2], 3.0 * BERNOULLI[3], 4.0 * BERNOULLI[4]];

/// Squared rotation angle up to which fewer terms suffice, as in most steps.
pub(super) const SMALL: f64 = 0.02;

/// Polynomials of the series, with as many terms as number type and angles need. The choice is made per lane, so that other
/// lanes have no influence.
#[inline(always)]
pub(super) fn series<L: Lane, const K: usize>(z: L, coefficients: [&[f64; TERMS]; K]) -> [L; K] {
    let mut values = [z; K];
    unroll!(k < K => {
        let c = coefficients[k];
        values[k] = if const { L::Real::SINGLE } { horner(z, first::<4>(c)) } else { horner(z, first::<6>(c)) };
    });
    let large = L::c(SMALL).lt(z);
    if L::any(large) {
        unroll!(k < K => {
            let c = coefficients[k];
            let all = if const { L::Real::SINGLE } { horner(z, first::<9>(c)) } else { horner(z, c) };
            values[k] = L::select(large, all, values[k]);
        });
    }
    values
}

/// `exp [xi]` for rotation parts up to pi. `[MLS94 eq. 2.36]`
#[inline(always)]
pub fn exp_se3<L: Lane>(xi: Vector6<L>) -> Pose<L> {
    let w = xi.angular;
    let z = w.dot(w);
    let [s, c, b] = series(z, [&SERIES.s, &SERIES.c, &SERIES.b]);
    let [x, y, t] = w.0;
    let (cx, cy, ct) = (c * x, c * y, c * t);
    let (sx, sy, st) = (s * x, s * y, s * t);
    let rotation = Matrix3([
        [y.neg_mul_add(cy, t.neg_mul_add(ct, L::c(1.0))), cx.mul_add(y, -st), cx.mul_add(t, sy)],
        [cx.mul_add(y, st), x.neg_mul_add(cx, t.neg_mul_add(ct, L::c(1.0))), cy.mul_add(t, -sx)],
        [cx.mul_add(t, -sy), cy.mul_add(t, sx), x.neg_mul_add(cx, y.neg_mul_add(cy, L::c(1.0)))],
    ]);
    let turn = w.cross(xi.linear);
    let position = w.cross(turn).scale_add(b, turn.scale_add(c, xi.linear));
    Pose { rotation, position }
}

/// `exp([w])^T x`: rotates a vector from the body axes before a rotation `w` (at most pi) to the axes after it.
#[inline(always)]
pub fn rotate_back<L: Lane>(w: Vector3<L>, x: Vector3<L>) -> Vector3<L> {
    let z = w.dot(w);
    let [s, c] = series(z, [&SERIES.s, &SERIES.c]);
    let turn = w.cross(x);
    w.cross(turn).scale_add(c, turn.scale_add(-s, x))
}

/// Truncation of the series of `dexp^-1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DexpInverse {
    /// Closed form, exact for rotations below 2 pi.
    Closed,
    /// `I + ad/2 + ad^2/12`, sufficient for order 4: the truncation adds an error of order 5.
    Truncated,
}

/// A and A' at z: see the module documentation.
#[inline(always)]
pub(super) fn dexp_inverse_coefficients<L: Lane>(z: L) -> [L; 2] {
    let mut values = if const { L::Real::SINGLE } {
        [horner(z, first::<2>(&BERNOULLI)), horner(z, first::<1>(&BERNOULLI_SLOPE))]
    } else {
        [horner(z, &BERNOULLI), horner(z, &BERNOULLI_SLOPE)]
    };
    let large = L::c(SMALL).lt(z);
    if L::any(large) {
        let [c, p, q] = series(z, [&SERIES.c, &SERIES.p, &SERIES.q]);
        let scale = L::c(0.25) / c;
        let slope = -(q * scale);
        values[0] = L::select(large, slope.mul_add(z, p * scale), values[0]);
        values[1] = L::select(large, slope, values[1]);
    }
    values
}

/// `dexp^-1_(-theta) V = V + ad V / 2 + p ad^2 V + q ad^4 V` with `ad = ad_theta`. `[HC eq. 18]`, `[PC05]`
#[inline(always)]
pub fn dexp_inverse_negative<L: Lane>(form: DexpInverse, theta: Vector6<L>, v: Vector6<L>) -> Vector6<L> {
    let ad1 = ad(theta, v);
    let ad2 = ad(theta, ad1);
    let half = ad1.scale_add(L::c(0.5), v);
    match form {
        DexpInverse::Truncated => ad2.scale_add(L::c(1.0 / 12.0), half),
        DexpInverse::Closed => {
            let [a, slope] = dexp_inverse_coefficients(theta.angular.dot(theta.angular));
            let mut rate = ad2.scale_add(a, half);
            let mixed = theta.angular.dot(theta.linear);
            rate.linear = ad2.angular.scale_add((mixed + mixed) * slope, rate.linear);
            rate
        }
    }
}

//! Adjoints of the exponential map and of the inverse of its differential: cotangents of arguments from cotangents of results.
//!
//! Rotations have cotangents in local coordinates: `R exp([delta])` with delta in body axes. `d exp([w]) = exp([w]) [J_r dw]` with
//! `J_r = I - C [w] + B [w]^2`, in the series of [`super::exponential`].

use super::exponential::{BERNOULLI_SLOPE, DexpInverse, SERIES, SMALL, TERMS, dexp_inverse_coefficients, series};
use super::{Vector3, Vector6, ad};
use crate::lane::{Lane, horner};

/// Coefficients of the derivative of a series.
const fn slopes<const N: usize>(c: &[f64]) -> [f64; N] {
    let mut slopes = [0.0; N];
    let mut k = 1;
    while k < c.len() && k <= N {
        slopes[k - 1] = k as f64 * c[k];
        k += 1;
    }
    slopes
}

const C_SLOPE: [f64; TERMS] = slopes(&SERIES.c);
const B_SLOPE: [f64; TERMS] = slopes(&SERIES.b);
const Q_SLOPE: [f64; TERMS] = slopes(&SERIES.q);
const BERNOULLI_CURVATURE: [f64; 3] = slopes(&BERNOULLI_SLOPE);

/// Cotangents of a and b from the cotangent of `ad_a b`.
#[inline(always)]
pub fn ad_adjoint<L: Lane>(a: Vector6<L>, b: Vector6<L>, of: Vector6<L>) -> (Vector6<L>, Vector6<L>) {
    let (p, l) = (of.linear, of.angular);
    let of_a = Vector6 { linear: b.angular.cross(p), angular: b.linear.cross_add(p, b.angular.cross(l)) };
    let of_b = Vector6 { linear: p.cross(a.angular), angular: p.cross_add(a.linear, l.cross(a.angular)) };
    (of_a, of_b)
}

/// `J_r^T x`, and `exp([w]) x`.
#[inline(always)]
fn turned<L: Lane>(w: Vector3<L>, [s, c, b]: [L; 3], x: Vector3<L>) -> (Vector3<L>, Vector3<L>) {
    let once = w.cross(x);
    let twice = w.cross(once);
    (twice.scale_add(b, once.scale_add(c, x)), twice.scale_add(c, once.scale_add(s, x)))
}

/// Cotangents of theta and of the rotation R before it, from the cotangents of `T exp(theta)`: of the position, in the axes of R
/// and if there is one, and of the rotation, in its own axes.
#[inline(always)]
pub fn increment_adjoint<L: Lane>(
    theta: Vector6<L>,
    of_position: Option<Vector3<L>>,
    of_turn: Vector3<L>,
) -> (Vector6<L>, Vector3<L>) {
    let (u, w) = (theta.linear, theta.angular);
    let z = w.dot(w);
    let [s, c, b] = series(z, [&SERIES.s, &SERIES.c, &SERIES.b]);
    let (mut angular, mut before) = turned(w, [s, c, b], of_turn);
    let mut linear = Vector3::zero();
    if let Some(of) = of_position {
        // p = u + C w x u + B w x (w x u)
        let turn = w.cross(u);
        let twice = w.cross(turn);
        let position = twice.scale_add(b, turn.scale_add(c, u));
        before = position.cross_add(of, before);
        let once = w.cross(of);
        linear = w.cross(once).scale_add(b, once.scale_add(-c, of));
        angular = u.cross(of).scale_add(c, angular);
        angular = (turn.cross(of) - u.cross(once)).scale_add(b, angular);
        let [c_slope, b_slope] = series(z, [&C_SLOPE, &B_SLOPE]);
        let of_z = c_slope.mul_add(of.dot(turn), b_slope * of.dot(twice)) * L::c(2.0);
        angular = w.scale_add(of_z, angular);
    }
    (Vector6 { linear, angular }, before)
}

/// Cotangents of w and x from the cotangent of [`super::rotate_back`].
#[inline(always)]
pub fn rotate_back_adjoint<L: Lane>(w: Vector3<L>, x: Vector3<L>, of: Vector3<L>) -> (Vector3<L>, Vector3<L>) {
    let [s, c, b] = series(w.dot(w), [&SERIES.s, &SERIES.c, &SERIES.b]);
    let (_, of_x) = turned(w, [s, c, b], of);
    // d (E^T x) = (E^T x) x (J_r dw)
    let turn = w.cross(x);
    let y = w.cross(turn).scale_add(c, turn.scale_add(-s, x));
    let (of_w, _) = turned(w, [s, c, b], of.cross(y));
    (of_w, of_x)
}

/// Cotangents of theta and V from the cotangent of [`super::dexp_inverse_negative`].
#[inline(always)]
pub fn dexp_inverse_adjoint<L: Lane>(
    form: DexpInverse,
    theta: Vector6<L>,
    v: Vector6<L>,
    of: Vector6<L>,
) -> (Vector6<L>, Vector6<L>) {
    let ad1 = ad(theta, v);
    let (mut of_theta, of_ad1) = match form {
        DexpInverse::Truncated => ad_adjoint(theta, ad1, of.scale(L::c(1.0 / 12.0))),
        DexpInverse::Closed => {
            let ad2 = ad(theta, ad1);
            let (w, u) = (theta.angular, theta.linear);
            let z = w.dot(w);
            let [a, slope] = dexp_inverse_coefficients(z);
            let (two, mixed) = (L::c(2.0), w.dot(u));
            let mut of_ad2 = of.scale(a);
            of_ad2.angular = of.linear.scale_add(mixed * slope * two, of_ad2.angular);
            let along = of.linear.dot(ad2.angular) * two;
            let of_z = slope.mul_add(of.dot(ad2), curvature(z) * mixed * along) * two;
            let (mut of_theta, of_ad1) = ad_adjoint(theta, ad1, of_ad2);
            of_theta.linear = w.scale_add(slope * along, of_theta.linear);
            of_theta.angular = w.scale_add(of_z, u.scale_add(slope * along, of_theta.angular));
            (of_theta, of_ad1)
        }
    };
    let (more, of_v) = ad_adjoint(theta, v, of.scale_add(L::c(0.5), of_ad1));
    of_theta = of_theta + more;
    (of_theta, of + of_v)
}

/// Second derivative of the coefficient A by z, `(Q C' / C - Q') / (4 C)`.
#[inline(always)]
fn curvature<L: Lane>(z: L) -> L {
    let mut value = horner(z, &BERNOULLI_CURVATURE);
    let large = L::c(SMALL).lt(z);
    if L::any(large) {
        let [c, q, c_slope, q_slope] = series(z, [&SERIES.c, &SERIES.q, &C_SLOPE, &Q_SLOPE]);
        let over_c = L::c(1.0) / c;
        value = L::select(large, (q * c_slope * over_c - q_slope) * over_c * L::c(0.25), value);
    }
    value
}

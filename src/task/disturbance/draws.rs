//! Draws of a control period.

use crate::lane::{Lane, ln, sin_cos};

/// Uniform numbers of a draw.
pub(super) const QUAD: usize = 4;

/// Two independent normal numbers from two uniform ones in (0, 1] (Box-Muller).
#[inline(always)]
pub(super) fn normal_pair<L: Lane>([u, v]: [L; 2]) -> [L; 2] {
    let radius = (ln(u) * L::c(-2.0)).max(L::zero()).sqrt();
    let (sine, cosine) = sin_cos(v * L::c(std::f64::consts::TAU));
    [radius * cosine, radius * sine]
}

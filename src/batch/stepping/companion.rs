//! Companions: the same motions integrated at another step, whose differences estimate errors.
//!
//! In a call of n steps of size h the companion takes m steps of size r h under the same inputs, from its own state. The errors
//! of a method of order p at the steps h and r h are as 1 to `r^p`: the error of the instance is the difference over
//! `|r^p - 1|`, to leading order and however the errors of the steps add up `[HNW93 sec. II.4]`. Kinks of the forces leave any
//! method order 2: the divisor is a geometric mean of that of order p, twice, and that of order 2.

use crate::batch::storage::columns::Columns;
use crate::batch::storage::layout::{CompanionRows, GIVEN, Layout, SCALES};
use crate::integrate::Integrator;
use crate::lane::{Kernel, Lane, Real};
use crate::lie::{Matrix3, Vector3};

/// Least scale of a motion, m, rad, m/s or rad/s: errors of smaller motions are set against this.
const LEAST_SCALE: f64 = 1e-3;
/// Greatest scale of rotation and joint travel, rad or m.
const GREATEST_ANGLE: f64 = 1.0;

/// Steps of the companions in a part of a call.
#[derive(Debug, Clone, Copy)]
pub struct CompanionSteps {
    /// Integrator.
    pub integrator: Integrator,
    /// Step, s.
    pub h: f64,
    /// Number of steps before these.
    pub before: usize,
    /// Number of steps.
    pub substeps: usize,
    /// Divisor of the differences.
    pub divisor: f64,
}

impl CompanionSteps {
    /// Steps of the companions beside steps `before` to `before + substeps` of `total` steps of size `h`: three fifths as many, at
    /// least half; with `halves`, and of a single step, twice as many.
    pub fn new<T: Real>(integrator: &Integrator, h: f64, [before, substeps, total]: [usize; 3], halves: bool) -> Self {
        let count = if halves || total == 1 { 2 * total } else { (3 * total / 5).max(total.div_ceil(2)) };
        let at = |step: usize| step * count / total.max(1);
        let ratio = total as f64 / count as f64;
        let divisor = |order: usize| (ratio.powi(order as i32) - 1.0).abs();
        let order = integrator.order();
        let divisor = (divisor(order).powi(2) * divisor(2)).cbrt();
        // Rounding bounds tolerances from below: those of both motions have to differ.
        let integrator = integrator.at_ratio(ratio, ratio.powi(order as i32), T::EPSILON).resolving_bounces();
        let (first, end) = (at(before), at(before + substeps));
        Self { integrator, h: h * ratio, before: first, substeps: end - first, divisor }
    }
}

/// Kernel at the start of a call: companions of instances whose state has been set begin there.
pub struct BeginCompanions<'a, T> {
    /// Rows of the companions.
    pub rows: &'a CompanionRows,
    /// Rows of the instances.
    pub layout: &'a Layout,
    /// Divisor of the differences in this call.
    pub divisor: f64,
    /// The blocks.
    pub blocks: &'a mut [T],
}

impl<T: Real> Kernel<T> for BeginCompanions<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        let (rows, layout) = (self.rows, self.layout);
        let blocks = std::mem::take(&mut self.blocks).chunks_exact_mut((layout.rows * T::BLOCK).max(1));
        let given = rows.state.len().saturating_sub(GIVEN);
        for block in blocks {
            for first in (0..T::BLOCK).step_by(L::LANES) {
                let mut columns = Columns { rows: &mut *block, first };
                let follows = L::c(0.5).lt(columns.get(rows.follows));
                for (k, &[from, to]) in rows.state.iter().enumerate() {
                    let (new, old): (L, L) = (columns.get(from), columns.get(to));
                    columns.set(to, if k < given { L::select(follows, old, new) } else { new });
                }
                for (row, count, to) in [
                    (layout.position, 3, rows.start),
                    (layout.rotation, 9, rows.start + 3),
                    (layout.q, layout.joints, rows.start + 12),
                ] {
                    for k in 0..count {
                        let (new, old): (L, L) = (columns.get(row + k), columns.get(to + k));
                        columns.set(to + k, L::select(follows, old, new));
                    }
                }
                // The scales, and behind them the relative error.
                for row in rows.scales..=rows.relative {
                    let kept = columns.get(row);
                    columns.set(row, L::select(follows, kept, L::zero()));
                }
                let (divisor, least) = (L::c(self.divisor), columns.get::<L>(rows.divisor));
                columns.set(rows.divisor, L::select(follows, divisor.min(least), divisor));
                columns.set(rows.follows, L::c(1.0));
            }
        }
    }
}

/// Kernel at the end of a call: scales of the motions, and errors relative to them.
pub struct CompareCompanions<'a, T> {
    /// Rows of the companions.
    pub rows: &'a CompanionRows,
    /// Rows of the instances.
    pub layout: &'a Layout,
    /// The blocks.
    pub blocks: &'a mut [T],
}

impl<T: Real> Kernel<T> for CompareCompanions<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        let (rows, layout, own) = (self.rows, self.layout, &self.rows.layout);
        let blocks = std::mem::take(&mut self.blocks).chunks_exact_mut((layout.rows * T::BLOCK).max(1));
        for block in blocks {
            for first in (0..T::BLOCK).step_by(L::LANES) {
                let mut columns = Columns { rows: &mut *block, first };
                let place: Vector3<L> = columns.vector(layout.position);
                let rotation: Matrix3<L> = columns.matrix(layout.rotation);
                let (twist, other) = (columns.six::<L>(layout.twist), columns.six::<L>(own.twist));
                let rest: Vector3<L> = columns.vector(own.position + 3) - columns.vector(layout.position + 3);
                let mut motion = [
                    norm(place - columns.vector(rows.start)),
                    turn(rotation, columns.matrix(rows.start + 3)),
                    L::zero(),
                    norm(twist.linear),
                    norm(twist.angular),
                    L::zero(),
                ];
                let mut errors = [
                    norm(columns.vector(own.position) - place + rest),
                    turn(rotation, columns.matrix(own.rotation)),
                    L::zero(),
                    norm(other.linear - twist.linear),
                    norm(other.angular - twist.angular),
                    L::zero(),
                ];
                for k in 0..layout.joints {
                    let (q, qd): (L, L) = (columns.get(layout.q + k), columns.get(layout.qd + k));
                    let mut apart = columns.get::<L>(own.q + k) - q;
                    if T::SINGLE {
                        apart += columns.get::<L>(own.q_rest + k) - columns.get(layout.q_rest + k);
                    }
                    errors[2] = apart.abs().max(errors[2]);
                    errors[5] = (columns.get::<L>(own.qd + k) - qd).abs().max(errors[5]);
                    motion[2] = (q - columns.get(rows.start + 12 + k)).abs().max(motion[2]);
                    motion[5] = qd.abs().max(motion[5]);
                }
                for k in 0..SCALES {
                    let mut scale = motion[k].max(columns.get(rows.scales + k));
                    columns.set(rows.scales + k, scale);
                    if k == 1 || k == 2 {
                        scale = scale.min(L::c(GREATEST_ANGLE));
                    }
                    errors[k] = errors[k] / scale.max(L::c(LEAST_SCALE));
                }
                // NaN where any is not finite.
                let (mut greatest, mut finite) = (L::zero(), L::zero());
                for k in 0..errors.len() {
                    greatest = errors[k].max(greatest);
                    finite = errors[k].mul_add(L::zero(), finite);
                }
                columns.set(rows.relative, (greatest + finite) / columns.get(rows.divisor));
            }
        }
    }
}

#[inline(always)]
fn norm<L: Lane>(x: Vector3<L>) -> L {
    x.dot(x).sqrt()
}

/// Angle between two rotations, for small ones: the norm of their difference over the root of 2, 2 sin of half the angle.
#[inline(always)]
fn turn<L: Lane>(a: Matrix3<L>, b: Matrix3<L>) -> L {
    let mut sum = L::zero();
    for i in 0..3 {
        for k in 0..3 {
            let apart = a.0[i][k] - b.0[i][k];
            sum = apart.mul_add(apart, sum);
        }
    }
    (sum * L::c(0.5)).sqrt()
}

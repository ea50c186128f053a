//! Munthe-Kaas methods. `[HC eq. 17-18]`, `[PC05]`

use super::tableau::{STAGES, Tableau};
use super::{Derivative, Rates, StagePose};
use crate::lane::{Lane, Real};
use crate::lie::{DexpInverse, Pose, Vector3, Vector6, dexp_inverse_negative, exp_se3, rotate_back};

/// State of a step: `(T, V, q, q')`.
#[derive(Debug, Clone, Copy)]
pub struct Motion<L, const N: usize> {
    /// T.
    pub pose: Pose<L>,
    /// V, body twist.
    pub twist: Vector6<L>,
    /// q.
    pub q: [L; N],
    /// q'.
    pub qd: [L; N],
}

/// Rates at each stage: working memory.
#[derive(Debug, Clone)]
pub struct Stages<L, const N: usize> {
    /// dexp^-1 V.
    theta: [Vector6<L>; STAGES],
    /// Joint rates.
    q: [[L; N]; STAGES],
    /// V' and q''.
    rates: [Rates<L, N>; STAGES],
}

impl<L: Lane, const N: usize> Stages<L, N> {
    /// Fresh memory; its contents never matter.
    pub fn new() -> Self {
        let rates = Rates { twist: Vector6::zero(), qd: [L::zero(); N] };
        Self { theta: [Vector6::zero(); STAGES], q: [[L::zero(); N]; STAGES], rates: [rates; STAGES] }
    }
}

impl<L: Lane, const N: usize> Default for Stages<L, N> {
    fn default() -> Self {
        Self::new()
    }
}

/// The pose `T exp(theta)` of a stage.
struct Increment<'a, L> {
    start: &'a Pose<L>,
    theta: Vector6<L>,
}

impl<L: Lane> StagePose<L> for Increment<'_, L> {
    #[inline(always)]
    fn to_body(&self, world: Vector3<L>) -> Vector3<L> {
        rotate_back(self.theta.angular, self.start.rotation.apply_transposed(world))
    }
    #[inline(always)]
    fn pose(&self) -> Pose<L> {
        self.start.times(&exp_se3(self.theta))
    }
}

/// One step of size `h`: `Theta_i = h sum a_ij dexp^-1_(-Theta_j) V_j`, `T_i = T exp(Theta_i)`.
///
/// Returns the square of the greatest rotation within the step; the result is good where it stays below pi^2.
#[inline(always)]
pub fn munthe_kaas<L: Lane, D: Derivative<L, N>, const N: usize>(
    tableau: &Tableau,
    form: DexpInverse,
    h: L::Real,
    motion: &mut Motion<L, N>,
    derivative: &mut D,
    stages: &mut Stages<L, N>,
) -> L {
    let n = derivative.joints();
    let mut greatest = L::zero();
    for i in 0..tableau.stages {
        let (theta, twist, q, qd);
        if i == 0 {
            (theta, twist, q, qd) = (Vector6::zero(), motion.twist, motion.q, motion.qd);
        } else {
            let sum = weighted(&tableau.a[i], i, n, h, stages);
            theta = sum.theta;
            twist = motion.twist + sum.rates.twist;
            (q, qd) = (plus(n, &motion.q, &sum.q), plus(n, &motion.qd, &sum.rates.qd));
            greatest = greatest.max(theta.angular.dot(theta.angular));
        }
        let at = Increment { start: &motion.pose, theta };
        derivative.rates(&at, L::splat(h * L::Real::from_f64(tableau.c[i])), twist, &q, &qd, &mut stages.rates[i]);
        stages.theta[i] = if i == 0 { twist } else { dexp_inverse_negative(form, theta, twist) };
        stages.q[i] = qd;
    }
    let sum = weighted(&tableau.b, tableau.stages, n, h, stages);
    greatest = greatest.max(sum.theta.angular.dot(sum.theta.angular));
    motion.pose = motion.pose.times(&exp_se3(sum.theta));
    motion.pose.rotation = motion.pose.rotation.orthonormalised();
    motion.twist = motion.twist + sum.rates.twist;
    motion.q = plus(n, &motion.q, &sum.q);
    motion.qd = plus(n, &motion.qd, &sum.rates.qd);
    greatest
}

/// A weighted sum of stages, times h.
struct Sum<L, const N: usize> {
    theta: Vector6<L>,
    q: [L; N],
    rates: Rates<L, N>,
}

#[inline(always)]
fn weighted<L: Lane, const N: usize>(
    weights: &[f64; STAGES],
    count: usize,
    n: usize,
    h: L::Real,
    stages: &Stages<L, N>,
) -> Sum<L, N> {
    let zero = [L::zero(); N];
    let mut sum = Sum { theta: Vector6::zero(), q: zero, rates: Rates { twist: Vector6::zero(), qd: zero } };
    for j in 0..count {
        if weights[j] == 0.0 {
            continue;
        }
        let weight = L::splat(h * L::Real::from_f64(weights[j]));
        let rates = &stages.rates[j];
        sum.theta = stages.theta[j].scale_add(weight, sum.theta);
        sum.rates.twist = rates.twist.scale_add(weight, sum.rates.twist);
        for k in 0..n {
            sum.q[k] = stages.q[j][k].mul_add(weight, sum.q[k]);
            sum.rates.qd[k] = rates.qd[k].mul_add(weight, sum.rates.qd[k]);
        }
    }
    sum
}

#[inline(always)]
fn plus<L: Lane, const N: usize>(n: usize, a: &[L; N], b: &[L; N]) -> [L; N] {
    let mut sum = *a;
    for k in 0..n {
        sum[k] += b[k];
    }
    sum
}

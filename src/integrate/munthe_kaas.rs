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
    /// q and q' of the stage at hand.
    q_at: [L; N],
    qd_at: [L; N],
}

impl<L: Lane, const N: usize> Stages<L, N> {
    /// Fresh memory; its contents never matter.
    pub fn new() -> Self {
        let zero = [L::zero(); N];
        let rates = Rates { twist: Vector6::zero(), qd: zero };
        Self { theta: [Vector6::zero(); STAGES], q: [zero; STAGES], rates: [rates; STAGES], q_at: zero, qd_at: zero }
    }

    /// `Theta = h sum w_j dexp^-1 V_j` and the likes of it: returns Theta and V, and leaves q and q' in `q_at`, `qd_at`.
    #[inline(always)]
    fn weigh(
        &mut self,
        weights: &[f64; STAGES],
        count: usize,
        n: usize,
        h: L::Real,
        from: &Motion<L, N>,
    ) -> (Vector6<L>, Vector6<L>) {
        let (mut theta, mut twist) = (Vector6::zero(), Vector6::zero());
        for k in 0..n {
            self.q_at[k] = L::zero();
            self.qd_at[k] = L::zero();
        }
        for j in 0..count {
            if weights[j] == 0.0 {
                continue;
            }
            let weight = L::splat(h * L::Real::from_f64(weights[j]));
            theta = self.theta[j].scale_add(weight, theta);
            twist = self.rates[j].twist.scale_add(weight, twist);
            for k in 0..n {
                self.q_at[k] = self.q[j][k].mul_add(weight, self.q_at[k]);
                self.qd_at[k] = self.rates[j].qd[k].mul_add(weight, self.qd_at[k]);
            }
        }
        for k in 0..n {
            self.q_at[k] += from.q[k];
            self.qd_at[k] += from.qd[k];
        }
        (theta, from.twist + twist)
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
        let (theta, twist) = if i == 0 {
            for k in 0..n {
                stages.q_at[k] = motion.q[k];
                stages.qd_at[k] = motion.qd[k];
            }
            (Vector6::zero(), motion.twist)
        } else {
            stages.weigh(&tableau.a[i], i, n, h, motion)
        };
        greatest = greatest.max(theta.angular.dot(theta.angular));
        let at = Increment { start: &motion.pose, theta };
        let elapsed = L::splat(h * L::Real::from_f64(tableau.c[i]));
        derivative.rates(&at, elapsed, twist, &stages.q_at, &stages.qd_at, &mut stages.rates[i]);
        stages.theta[i] = if i == 0 { twist } else { dexp_inverse_negative(form, theta, twist) };
        for k in 0..n {
            stages.q[i][k] = stages.qd_at[k];
        }
    }
    let (theta, twist) = stages.weigh(&tableau.b, tableau.stages, n, h, motion);
    greatest = greatest.max(theta.angular.dot(theta.angular));
    motion.pose = motion.pose.times(&exp_se3(theta));
    motion.pose.rotation = motion.pose.rotation.orthonormalised();
    motion.twist = twist;
    for k in 0..n {
        motion.q[k] = stages.q_at[k];
        motion.qd[k] = stages.qd_at[k];
    }
    greatest
}

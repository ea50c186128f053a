//! The paper's rivals: Runge-Kutta on the components of a quaternion. `[HC eq. 14]`

use super::tableau::{STAGES, Tableau};
use super::{Derivative, Rates, StagePose};
use crate::lane::{Lane, Real};
use crate::lie::{Matrix3, Pose, Vector3, Vector6};

/// What keeps the quaternion near unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Correction {
    /// The term `gamma/2 (1 - Q^T Q) Q` of eq. 14.
    Fossen {
        /// Its gain, 1/s.
        gamma: f64,
    },
    /// Division by the length after each step.
    Normalise,
}

/// State of a step, attitude as a quaternion `[w, x, y, z]` that need not be of unit length.
#[derive(Debug, Clone, Copy)]
pub struct QuaternionMotion<L, const N: usize> {
    /// Q.
    pub quaternion: [L; 4],
    /// r.
    pub position: Vector3<L>,
    /// V, body twist.
    pub twist: Vector6<L>,
    /// q.
    pub q: [L; N],
    /// q'.
    pub qd: [L; N],
}

impl<L: Lane, const N: usize> QuaternionMotion<L, N> {
    /// `R(Q) = I + 2 w [e] + 2 [e]^2` with Q as it is: no rotation unless Q is of unit length. `[F21 eq. 2.64]`
    #[inline(always)]
    pub fn rotation(&self) -> Matrix3<L> {
        let [w, x, y, z] = self.quaternion;
        let (x2, y2, z2) = (x + x, y + y, z + z);
        let one = L::c(1.0);
        Matrix3([
            [y.neg_mul_add(y2, z.neg_mul_add(z2, one)), x.mul_add(y2, -(w * z2)), x.mul_add(z2, w * y2)],
            [x.mul_add(y2, w * z2), x.neg_mul_add(x2, z.neg_mul_add(z2, one)), y.mul_add(z2, -(w * x2))],
            [x.mul_add(z2, -(w * y2)), y.mul_add(z2, w * x2), x.neg_mul_add(x2, y.neg_mul_add(y2, one))],
        ])
    }

    /// `self + h k`
    #[inline(always)]
    fn advanced(&self, h: L, k: &Self, n: usize) -> Self {
        let mut next = *self;
        for i in 0..4 {
            next.quaternion[i] = k.quaternion[i].mul_add(h, next.quaternion[i]);
        }
        next.position = k.position.scale_add(h, next.position);
        next.twist = k.twist.scale_add(h, next.twist);
        for i in 0..n {
            next.q[i] = k.q[i].mul_add(h, next.q[i]);
            next.qd[i] = k.qd[i].mul_add(h, next.qd[i]);
        }
        next
    }
}

impl<L: Lane> StagePose<L> for Pose<L> {
    #[inline(always)]
    fn to_body(&self, world: Vector3<L>) -> Vector3<L> {
        self.rotation.apply_transposed(world)
    }
    #[inline(always)]
    fn pose(&self) -> Pose<L> {
        *self
    }
}

/// One step of size `h` of `Q' = J_2(Q) omega + correction`, `r' = R(Q) v` and the rest.
#[inline(always)]
pub fn quaternion_runge_kutta<L: Lane, D: Derivative<L, N>, const N: usize>(
    tableau: &Tableau,
    correction: Correction,
    h: L::Real,
    motion: &mut QuaternionMotion<L, N>,
    derivative: &mut D,
) {
    let n = derivative.joints();
    let mut stages = [*motion; STAGES];
    for i in 0..tableau.stages {
        let mut at = *motion;
        for j in 0..i {
            at = at.advanced(scaled(h, tableau.a[i][j]), &stages[j], n);
        }
        let rotation = at.rotation();
        let pose = Pose { rotation, position: at.position };
        let mut rates = Rates { twist: Vector6::zero(), qd: [L::zero(); N] };
        derivative.rates(&pose, scaled(h, tableau.c[i]), at.twist, &at.q, &at.qd, &mut rates);
        stages[i] = QuaternionMotion {
            quaternion: quaternion_rate(at.quaternion, at.twist.angular, correction),
            position: rotation.apply(at.twist.linear),
            twist: rates.twist,
            q: at.qd,
            qd: rates.qd,
        };
    }
    let mut next = *motion;
    for i in 0..tableau.stages {
        next = next.advanced(scaled(h, tableau.b[i]), &stages[i], n);
    }
    if correction == Correction::Normalise {
        let length = squared(next.quaternion).sqrt();
        for x in &mut next.quaternion {
            *x = *x / length;
        }
    }
    *motion = next;
}

/// `h * weight`
#[inline(always)]
fn scaled<L: Lane>(h: L::Real, weight: f64) -> L {
    L::splat(h * L::Real::from_f64(weight))
}

#[inline(always)]
fn squared<L: Lane>(q: [L; 4]) -> L {
    q[0].mul_add(q[0], q[1].mul_add(q[1], q[2].mul_add(q[2], q[3] * q[3])))
}

/// `Q' = 1/2 [-e^T; w I + [e]] omega`, and eq. 14's term.
#[inline(always)]
fn quaternion_rate<L: Lane>(quaternion: [L; 4], omega: Vector3<L>, correction: Correction) -> [L; 4] {
    let [w, x, y, z] = quaternion;
    let e = Vector3([x, y, z]);
    let vector = omega.scale_add(w, e.cross(omega)).scale(L::c(0.5));
    let mut rate = [e.dot(omega) * L::c(-0.5), vector.0[0], vector.0[1], vector.0[2]];
    if let Correction::Fossen { gamma } = correction {
        let gain = (L::c(1.0) - squared(quaternion)) * L::c(0.5 * gamma);
        for i in 0..4 {
            rate[i] = quaternion[i].mul_add(gain, rate[i]);
        }
    }
    rate
}

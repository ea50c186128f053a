//! Kinematics of quaternions `[w, x, y, z]`, not necessarily of unit length. `[HC eq. 14]`

use super::chart::Correction;
use crate::lane::{Lane, unroll};
use crate::lie::{Matrix3, Vector3};

/// `R(Q) = I + 2 w [e] + 2 [e]^2` without normalisation: a rotation only where Q is of unit length. `[F21 eq. 2.64]`
#[inline(always)]
pub fn rotation<L: Lane>([w, x, y, z]: [L; 4]) -> Matrix3<L> {
    let (x2, y2, z2) = (x + x, y + y, z + z);
    let one = L::c(1.0);
    Matrix3([
        [y.neg_mul_add(y2, z.neg_mul_add(z2, one)), x.mul_add(y2, -(w * z2)), x.mul_add(z2, w * y2)],
        [x.mul_add(y2, w * z2), x.neg_mul_add(x2, z.neg_mul_add(z2, one)), y.mul_add(z2, -(w * x2))],
        [x.mul_add(z2, -(w * y2)), y.mul_add(z2, w * x2), x.neg_mul_add(x2, y.neg_mul_add(y2, one))],
    ])
}

/// `Q' = 1/2 [-e^T; w I + [e]] omega`, and eq. 14's term.
#[inline(always)]
pub fn rate<L: Lane>(quaternion: [L; 4], omega: Vector3<L>, correction: Correction) -> [L; 4] {
    let [w, x, y, z] = quaternion;
    let e = Vector3([x, y, z]);
    let vector = omega.scale_add(w, e.cross(omega)).scale(L::c(0.5));
    let mut rate = [e.dot(omega) * L::c(-0.5), vector.0[0], vector.0[1], vector.0[2]];
    if let Correction::Fossen { gamma } = correction {
        let gain = (L::c(1.0) - squared(quaternion)) * L::c(0.5 * gamma);
        unroll!(i in 0 1 2 3 => {
            rate[i] = quaternion[i].mul_add(gain, rate[i]);
        });
    }
    rate
}

/// The quaternion after a step.
#[inline(always)]
pub fn corrected<L: Lane>(mut quaternion: [L; 4], correction: Correction) -> [L; 4] {
    if correction == Correction::Normalise {
        let length = squared(quaternion).sqrt();
        unroll!(i in 0 1 2 3 => {
            quaternion[i] = quaternion[i] / length;
        });
    }
    quaternion
}

#[inline(always)]
fn squared<L: Lane>(q: [L; 4]) -> L {
    q[0].mul_add(q[0], q[1].mul_add(q[1], q[2].mul_add(q[2], q[3] * q[3])))
}

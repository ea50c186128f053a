//! Kinematics of roll, pitch and yaw, `R = Rz(yaw) Ry(pitch) Rx(roll)`. `[F21]`

use crate::lane::{Lane, sin_cos};
use crate::lie::{Matrix3, Vector3};

/// Rotation of `[0, roll, pitch, yaw]`, and the rates of these at a spin `omega` in body axes: infinite at a pitch of 90
/// degrees.
#[inline(always)]
pub fn rotation_and_rates<L: Lane>([zero, roll, pitch, yaw]: [L; 4], omega: Vector3<L>) -> (Matrix3<L>, [L; 4]) {
    let (sr, cr) = sin_cos(roll);
    let (sp, cp) = sin_cos(pitch);
    let (sy, cy) = sin_cos(yaw);
    let rotation = Matrix3([
        [cy * cp, (cy * sp).mul_add(sr, -(sy * cr)), (cy * sp).mul_add(cr, sy * sr)],
        [sy * cp, (sy * sp).mul_add(sr, cy * cr), (sy * sp).mul_add(cr, -(cy * sr))],
        [-sp, cp * sr, cp * cr],
    ]);
    let [p, q, r] = omega.0;
    let turn = sr.mul_add(q, cr * r) / cp;
    (rotation, [zero, sp.mul_add(turn, p), cr.mul_add(q, -(sr * r)), turn])
}

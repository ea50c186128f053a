//! Conversions of attitude: rotation matrix, quaternion, roll-pitch-yaw, rotation vector.

use nalgebra::{Matrix3, Vector3};

/// Unit quaternion `[w, x, y, z]`, w >= 0, of a rotation matrix; accurate at every angle (largest component first).
pub fn quaternion(r: &Matrix3<f64>) -> [f64; 4] {
    // Diagonal, and the row of the largest component, of four times the outer product of the quaternion with itself.
    let (a, b, c) = (r[(0, 0)], r[(1, 1)], r[(2, 2)]);
    let squares = [1.0 + a + b + c, 1.0 + a - b - c, 1.0 - a + b - c, 1.0 - a - b + c];
    let vector = [r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]];
    let (xy, xz, yz) = (r[(0, 1)] + r[(1, 0)], r[(0, 2)] + r[(2, 0)], r[(1, 2)] + r[(2, 1)]);
    let row = match (0..4).fold(0, |best, k| if squares[k] > squares[best] { k } else { best }) {
        0 => [squares[0], vector[0], vector[1], vector[2]],
        1 => [vector[0], squares[1], xy, xz],
        2 => [vector[1], xy, squares[2], yz],
        _ => [vector[2], xz, yz, squares[3]],
    };
    let length = row.iter().map(|x| x * x).sum::<f64>().sqrt();
    let sign = if row[0] < 0.0 { -1.0 } else { 1.0 };
    row.map(|x| sign * x / length)
}

/// Rotation matrix of a quaternion `[w, x, y, z]` of any positive length.
pub fn rotation(quaternion: &[f64; 4]) -> Matrix3<f64> {
    let length = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [w, x, y, z] = quaternion.map(|c| c / length);
    Matrix3::new(
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )
}

/// Roll, pitch and yaw, rad, of `R = Rz(yaw) Ry(pitch) Rx(roll)`; pitch within a quarter revolution.
pub fn roll_pitch_yaw(r: &Matrix3<f64>) -> [f64; 3] {
    let pitch = (-r[(2, 0)]).atan2(r[(2, 1)].hypot(r[(2, 2)]));
    [r[(2, 1)].atan2(r[(2, 2)]), pitch, r[(1, 0)].atan2(r[(0, 0)])]
}

/// Rotation vector `log R`, of length at most pi.
pub fn rotation_vector(r: &Matrix3<f64>) -> Vector3<f64> {
    let [w, x, y, z] = quaternion(r);
    let e = Vector3::new(x, y, z);
    let sine = e.norm();
    // 2 atan2(s, w) / s, by its series where s is small.
    let scale = if sine < 1e-4 { 2.0 / w * (1.0 - sine * sine / (3.0 * w * w)) } else { 2.0 * sine.atan2(w) / sine };
    scale * e
}

//! Joint motions that servos follow.

use uvms_gym::system::{Joints, State};

/// Joints sway about a posture, each in its own phase: `q = q_0 + A sin(w t + p)`.
pub struct Sway {
    q: Joints,
    joints: usize,
}

/// Frequency of the motion and maximum rate of a joint, rad/s.
const FREQUENCY: f64 = 0.8;
const RATE: f64 = 0.3;

impl Sway {
    pub fn about(q: Joints, joints: usize) -> Self {
        Self { q, joints }
    }

    fn at(&self, k: usize, t: f64) -> (f64, f64) {
        let phase = 0.7 * k as f64;
        let (sin, cos) = (FREQUENCY * t + phase).sin_cos();
        (self.q[k] + RATE / FREQUENCY * sin, RATE * cos)
    }

    /// Sets the joints as the motion starts.
    pub fn start(&self, state: &mut State) {
        for k in 0..self.joints {
            (state.q[k], state.qd[k]) = self.at(k, 0.0);
        }
    }

    /// Targets over the second after `t`: cubics that meet the motion's values and rates at both ends.
    pub fn target(&self, t: f64) -> Vec<f64> {
        (0..self.joints)
            .flat_map(|k| {
                let ((p0, v0), (p1, v1)) = (self.at(k, t), self.at(k, t + 1.0));
                [p0, v0, 3.0 * (p1 - p0) - 2.0 * v0 - v1, 2.0 * (p0 - p1) + v0 + v1]
            })
            .collect()
    }
}

/// Cubics `target`, seen from `elapsed` later.
pub fn later(target: &[f64], elapsed: f64) -> Vec<f64> {
    let shift = |c: &[f64]| {
        let (s, [a, b, c, d]) = (elapsed, [c[0], c[1], c[2], c[3]]);
        [a + s * (b + s * (c + s * d)), b + s * (2.0 * c + 3.0 * s * d), c + 3.0 * s * d, d]
    };
    target.chunks(4).flat_map(shift).collect()
}

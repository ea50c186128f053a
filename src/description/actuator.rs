//! Linear actuators of revolute joints.

use serde::{Deserialize, Serialize};

/// Linear actuator of a revolute joint, between a point of the parent and a point of the link. With the distances a and b of
/// these points from the joint's axis, the stroke s is, by the law of cosines,
///
/// ```text
/// s(q) = sqrt(a^2 + b^2 - 2 a b cos(q + angle)),    torque = force ds/dq = force a b sin(q + angle) / s
/// ```
///
/// so the maximum torque depends on q.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinearActuator {
    /// a, distance from the axis to the point on the parent, m.
    pub base: f64,
    /// b, distance from the axis to the point on the link, m.
    pub lever: f64,
    /// Angle between the two at q = 0, rad.
    pub angle: f64,
    /// Maximum force either way, N.
    pub force: f64,
}

impl LinearActuator {
    /// Stroke s at joint coordinate `q`, m.
    pub fn stroke(&self, q: f64) -> f64 {
        let (a, b) = (self.base, self.lever);
        (a * a + b * b - 2.0 * a * b * (q + self.angle).cos()).sqrt()
    }

    /// Lever arm ds/dq at joint coordinate `q`, m.
    pub fn arm(&self, q: f64) -> f64 {
        self.base * self.lever * (q + self.angle).sin() / self.stroke(q)
    }
}

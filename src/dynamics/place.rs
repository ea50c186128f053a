//! The frame that moves with the water, in which the passes work, and the world.

use crate::lane::Lane;
use crate::lie::{Pose, Vector3, Vector6};

/// The water during a step, world axes.
#[derive(Debug, Clone, Copy)]
pub struct WaterFrame<L> {
    /// Velocity at the start of the step, m/s.
    pub velocity: Vector3<L>,
    /// Acceleration, m/s2.
    pub acceleration: Vector3<L>,
    /// Gravity less the acceleration, m/s2.
    pub gravity: Vector3<L>,
}

/// Pose and absolute motion of the vehicle.
#[derive(Debug, Clone, Copy)]
pub struct Place<L> {
    /// Pose in the world, m.
    pub pose: Pose<L>,
    /// Absolute twist, body axes, m/s and rad/s.
    pub twist: Vector6<L>,
}

impl<L: Lane> WaterFrame<L> {
    /// At rest, without gravity.
    #[inline(always)]
    pub fn still() -> Self {
        let zero = Vector3::zero();
        Self { velocity: zero, acceleration: zero, gravity: zero }
    }

    /// Velocity after a time, m/s.
    #[inline(always)]
    pub fn velocity_after(&self, elapsed: L) -> Vector3<L> {
        self.acceleration.scale_add(elapsed, self.velocity)
    }

    /// Place in the world, from a pose relative to the water since the start of the step and a twist relative to the water.
    #[inline(always)]
    pub fn place(&self, pose: &Pose<L>, elapsed: L, twist: Vector6<L>) -> Place<L> {
        let half = self.acceleration.scale_add(elapsed * L::c(0.5), self.velocity);
        let position = half.scale_add(elapsed, pose.position);
        let linear = twist.linear + pose.rotation.apply_transposed(self.velocity_after(elapsed));
        Place { pose: Pose { rotation: pose.rotation, position }, twist: Vector6 { linear, angular: twist.angular } }
    }

    /// Twist of the world relative to the water.
    #[inline(always)]
    pub fn world_twist(&self, elapsed: L) -> Vector6<L> {
        Vector6 { linear: -self.velocity_after(elapsed), angular: Vector3::zero() }
    }

    /// Rate of [`Self::world_twist`].
    #[inline(always)]
    pub fn world_rate(&self) -> Vector6<L> {
        Vector6 { linear: -self.acceleration, angular: Vector3::zero() }
    }
}

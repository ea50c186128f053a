//! Cotangents of a step's state, and of a pose within a step.

use super::{Motion, Rates};
use crate::lane::{Lane, Tape, unroll};
use crate::lie::{Pose, Vector3, Vector6, increment_adjoint};

/// Cotangents of a [`super::Motion`].
#[derive(Debug, Clone, Copy)]
pub struct MotionCotangents<L, const N: usize> {
    /// Cotangent of the position, world axes.
    pub position: Vector3<L>,
    /// Cotangent of the rotation: of delta in `R exp([delta])`, body axes.
    pub turn: Vector3<L>,
    /// Cotangent of the twist.
    pub twist: Vector6<L>,
    /// Cotangent of q.
    pub q: [L; N],
    /// Cotangent of q'.
    pub qd: [L; N],
}

impl<L: Lane, const N: usize> MotionCotangents<L, N> {
    /// Zeros.
    #[inline(always)]
    pub fn zero() -> Self {
        let (three, zero) = (Vector3::zero(), [L::zero(); N]);
        Self { position: three, turn: three, twist: Vector6::zero(), q: zero, qd: zero }
    }

    /// Sets those of the vehicle and of the joints in use to 0.
    #[inline(always)]
    pub fn clear(&mut self, joints: usize) {
        (self.position, self.turn, self.twist) = (Vector3::zero(), Vector3::zero(), Vector6::zero());
        for k in 0..joints.min(N) {
            (self.q[k], self.qd[k]) = (L::zero(), L::zero());
        }
    }

    /// Sets these to others where the mask holds.
    #[inline(always)]
    pub(super) fn set_where(&mut self, mask: L::Mask, other: &Self, n: usize) {
        unroll!(k in 0 1 2 => {
            self.position.0[k] = L::select(mask, other.position.0[k], self.position.0[k]);
            self.turn.0[k] = L::select(mask, other.turn.0[k], self.turn.0[k]);
            self.twist.linear.0[k] = L::select(mask, other.twist.linear.0[k], self.twist.linear.0[k]);
            self.twist.angular.0[k] = L::select(mask, other.twist.angular.0[k], self.twist.angular.0[k]);
        });
        for k in 0..n {
            self.q[k] = L::select(mask, other.q[k], self.q[k]);
            self.qd[k] = L::select(mask, other.qd[k], self.qd[k]);
        }
    }
}

/// Cotangents of a pose: of its position, world axes, where it has any, and of its rotation, its own axes.
#[derive(Debug, Clone, Copy)]
pub struct PoseCotangents<L> {
    /// Cotangent of the position.
    pub position: Option<Vector3<L>>,
    /// Cotangent of the rotation.
    pub turn: Vector3<L>,
}

impl<L: Lane> PoseCotangents<L> {
    /// Cotangent of theta in this pose, `T exp(theta)`; adds the cotangent of T.
    #[inline(always)]
    pub(super) fn pull_back<const N: usize>(
        &self,
        theta: Vector6<L>,
        start: &Pose<L>,
        of_start: &mut MotionCotangents<L, N>,
    ) -> Vector6<L> {
        let position = if let Some(position) = self.position {
            of_start.position = of_start.position + position;
            Some(start.rotation.apply_transposed(position))
        } else {
            None
        };
        let (of_theta, turn) = increment_adjoint(theta, position, self.turn);
        of_start.turn = of_start.turn + turn;
        of_theta
    }
}

/// Pose and velocities of a stage, for the adjoint of the right-hand side.
#[derive(Debug, Clone, Copy)]
pub struct StagePoint<'a, L, const N: usize> {
    /// Start of the step.
    pub start: &'a Pose<L>,
    /// Theta of the pose `T exp(theta)`.
    pub theta: Vector6<L>,
    /// Body twist, m/s and rad/s.
    pub twist: Vector6<L>,
    /// Joint coordinates, rad or m.
    pub q: &'a [L; N],
    /// Joint rates, rad/s or m/s.
    pub qd: &'a [L; N],
}

/// Cotangents of a stage.
#[derive(Debug, Clone, Copy)]
pub struct StageCotangents<L, const N: usize> {
    /// Cotangent of the pose.
    pub pose: PoseCotangents<L>,
    /// Cotangent of the twist.
    pub twist: Vector6<L>,
    /// Cotangent of q.
    pub q: [L; N],
    /// Cotangent of q'.
    pub qd: [L; N],
}

impl<L: Lane, const N: usize> StageCotangents<L, N> {
    /// Zeros, to be overwritten.
    #[inline(always)]
    pub fn blank() -> Self {
        let pose = PoseCotangents { position: None, turn: Vector3::zero() };
        Self { pose, twist: Vector6::zero(), q: [L::zero(); N], qd: [L::zero(); N] }
    }
}

/// Adjoint of a right-hand side.
pub trait DerivativeAdjoint<L: Lane, const N: usize> {
    /// Number of joints in use.
    fn joints(&self) -> usize;
    /// Cotangents of a stage from the cotangents of its rates `[V'; q'']`. `rates` is the value of the right-hand side. Adds the
    /// cotangents of inputs and parameters. `when` is the time of the stage after the start of the interval, and for linearly implicit
    /// methods the size of the solve that begins there.
    fn rates_adjoint(
        &mut self,
        at: &StagePoint<L, N>,
        when: (L, Option<L>),
        rates: &Rates<L, N>,
        of_rates: &Rates<L, N>,
        of_stage: &mut StageCotangents<L, N>,
    );
}

/// Adjoint of a method's sub-intervals.
pub trait MethodAdjoint<L: Lane, const N: usize> {
    /// The method.
    type Method;
    /// Replaces the cotangents at the end of a record's last sub-interval by the cotangents at its start, in the lanes that took it, and
    /// removes it.
    fn reverse<D: DerivativeAdjoint<L, N>>(
        &mut self,
        method: &Self::Method,
        tape: &mut Tape<L::Real>,
        derivative: &mut D,
        of: &mut MotionCotangents<L, N>,
    );
    /// Start of the sub-interval that was reversed last.
    fn start(&self) -> &Motion<L, N>;
}

//! State of a step.

use crate::lane::{Lane, unroll};
use crate::lie::{Matrix3, Pose, Vector3, Vector6, exp_se3};

/// State of a step: `(T, V, q, q')`.
#[derive(Debug, Clone, Copy)]
pub struct Motion<L, const N: usize> {
    /// T.
    pub pose: Pose<L>,
    /// Rounding error of the position (compensated sum).
    pub rest: Vector3<L>,
    /// V, body twist.
    pub twist: Vector6<L>,
    /// Joint coordinates, rad or m.
    pub q: [L; N],
    /// Joint rates, rad/s or m/s.
    pub qd: [L; N],
    /// Coordinates of the attitude, for charts that keep them; the pose follows from them.
    pub attitude: [L; 4],
}

impl<L: Lane, const N: usize> Motion<L, N> {
    /// At rest at the origin: memory to load a motion into.
    #[inline(always)]
    pub fn blank() -> Self {
        let zero = [L::zero(); N];
        let pose = Pose { rotation: Matrix3::identity(), position: Vector3::zero() };
        Self { pose, rest: Vector3::zero(), twist: Vector6::zero(), q: zero, qd: zero, attitude: [L::zero(); 4] }
    }

    /// Adds to the position by a compensated sum: at steady speed each step adds the same number with the same rounding error,
    /// which would grow to a drift.
    #[inline(always)]
    pub fn travel(&mut self, by: Vector3<L>) {
        (self.pose.position, self.rest) = self.travelled(by);
    }

    /// Position after a displacement, and its rounding error.
    #[inline(always)]
    pub(super) fn travelled(&self, by: Vector3<L>) -> (Vector3<L>, Vector3<L>) {
        let passed = self.rest + by;
        let next = self.pose.position + passed;
        (next, passed - (next - self.pose.position))
    }

    /// Sets the pose to `T exp(theta)`, and twist and joints, where the mask holds.
    #[inline(always)]
    pub(super) fn move_by(
        &mut self,
        mask: L::Mask,
        theta: Vector6<L>,
        twist: Vector6<L>,
        joints: (&[L; N], &[L; N]),
        n: usize,
    ) {
        let increment = exp_se3(theta);
        let (position, rest) = self.travelled(self.pose.rotation.apply(increment.position));
        let rotation = self.pose.rotation.times(&increment.rotation).orthonormalised();
        self.set_where(mask, Pose { rotation, position }, rest, twist, joints, n);
    }

    /// Sets these numbers where the mask holds.
    #[inline(always)]
    pub(super) fn set_where(
        &mut self,
        mask: L::Mask,
        pose: Pose<L>,
        rest: Vector3<L>,
        twist: Vector6<L>,
        (q, qd): (&[L; N], &[L; N]),
        n: usize,
    ) {
        unroll!(i in 0 1 2 => {
            pick(mask, &pose.rotation.0[i], &mut self.pose.rotation.0[i], 3);
        });
        pick(mask, &pose.position.0, &mut self.pose.position.0, 3);
        pick(mask, &rest.0, &mut self.rest.0, 3);
        pick(mask, &twist.linear.0, &mut self.twist.linear.0, 3);
        pick(mask, &twist.angular.0, &mut self.twist.angular.0, 3);
        pick(mask, q, &mut self.q, n);
        pick(mask, qd, &mut self.qd, n);
    }

    /// Sets the attitude coordinates where the mask holds.
    #[inline(always)]
    pub(super) fn set_attitude_where(&mut self, mask: L::Mask, attitude: &[L; 4]) {
        pick(mask, attitude, &mut self.attitude, 4);
    }

    /// Sets all numbers to NaN where the mask holds.
    #[inline(always)]
    pub(super) fn set_nan_where(&mut self, mask: L::Mask, n: usize) {
        let x = L::c(f64::NAN);
        let nan = Vector3([x; 3]);
        let pose = Pose { rotation: Matrix3([nan.0; 3]), position: nan };
        self.set_where(mask, pose, nan, Vector6 { linear: nan, angular: nan }, (&[x; N], &[x; N]), n);
        self.set_attitude_where(mask, &[x; 4]);
    }

    /// 1 in lanes where every number (of `n` joints) is finite, else 0.
    #[inline(always)]
    pub(super) fn finite(&self, n: usize) -> L {
        let mut sum = L::zero();
        add_zeros(&self.pose.position.0, 3, &mut sum);
        unroll!(i in 0 1 2 => {
            add_zeros(&self.pose.rotation.0[i], 3, &mut sum);
        });
        add_zeros(&self.twist.to_array(), 6, &mut sum);
        add_zeros(&self.q, n, &mut sum);
        add_zeros(&self.qd, n, &mut sum);
        L::select(sum.lt(L::c(1.0)), L::c(1.0), L::zero())
    }
}

/// Zero times each number: NaN for one that is not finite.
#[inline(always)]
fn add_zeros<L: Lane, const K: usize>(x: &[L; K], count: usize, sum: &mut L) {
    for k in 0..count {
        *sum = x[k].mul_add(L::zero(), *sum);
    }
}

#[inline(always)]
fn pick<L: Lane, const K: usize>(mask: L::Mask, new: &[L; K], old: &mut [L; K], count: usize) {
    for k in 0..count {
        old[k] = L::select(mask, new[k], old[k]);
    }
}

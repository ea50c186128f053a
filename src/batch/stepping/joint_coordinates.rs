//! Joint coordinates over many steps: compensated sums in single precision, and prescribed joints.

use std::hint::cold_path;

use crate::batch::storage::layout::Layout;
use crate::dynamics::aba::ArmLoads;
use crate::integrate::Motion;
use crate::lane::{Lane, Real, Rows};
use crate::system::{JOINTS, System};

/// Sums of the joints' increments. In single precision a step integrates only the increments, from 0: a coordinate of many
/// turns would round each of them. In double precision it integrates the coordinates, and nothing here is used.
#[derive(Debug, Clone)]
pub struct JointSums<L> {
    /// Coordinates at the start of a step, while it is taken, else 0.
    pub base: [L; JOINTS],
    /// Rounding errors of the coordinates (compensated sums).
    rest: [L; JOINTS],
}

impl<L: Lane> JointSums<L> {
    /// Zeros.
    pub fn zero() -> Self {
        Self { base: [L::zero(); JOINTS], rest: [L::zero(); JOINTS] }
    }

    /// Begins a step of `n` joints.
    #[inline(always)]
    pub fn begin(&mut self, motion: &mut Motion<L, JOINTS>, n: usize) {
        if <L::Real as Real>::SINGLE {
            for k in 0..n {
                (self.base[k], motion.q[k]) = (motion.q[k], L::zero());
            }
        }
    }

    /// Ends it.
    #[inline(always)]
    pub fn end(&mut self, motion: &mut Motion<L, JOINTS>, n: usize) {
        if <L::Real as Real>::SINGLE {
            for k in 0..n {
                let passed = self.rest[k] + motion.q[k];
                let next = self.base[k] + passed;
                self.rest[k] = passed - (next - self.base[k]);
                (self.base[k], motion.q[k]) = (L::zero(), next);
            }
        }
    }

    /// Joint coordinates of a stage: the sums plus the integrator's increments `q`.
    #[inline(always)]
    pub fn coordinates<'a>(&self, q: &'a [L; JOINTS], n: usize, memory: &'a mut [L; JOINTS]) -> &'a [L; JOINTS] {
        if <L::Real as Real>::SINGLE {
            for k in 0..n {
                memory[k] = self.base[k] + q[k];
            }
            return memory;
        }
        q
    }

    /// Sets coordinates and rates of the prescribed joints to their targets at `time`.
    #[inline(always)]
    pub fn prescribe<P, B>(
        &mut self,
        system: &System<P, B>,
        loads: &ArmLoads<L>,
        time: L,
        motion: &mut Motion<L, JOINTS>,
    ) {
        if system.prescribed {
            cold_path();
            for (i, joint) in system.chain().iter().enumerate() {
                if let (true, Some((position, rate))) = (joint.prescribed, loads.target(i, time)) {
                    (motion.q[i], motion.qd[i], self.rest[i]) = (position, rate, L::zero());
                }
            }
        }
    }
}

impl<T: Real> Rows<'_, T> {
    /// Loads the sums.
    #[inline(always)]
    pub fn joint_sums<L: Lane<Real = T>>(&self, layout: &Layout, sums: &mut JointSums<L>) {
        if T::SINGLE {
            self.get_some(layout.q_rest, layout.joints, &mut sums.rest);
            sums.base = [L::zero(); JOINTS];
        }
    }

    /// Stores them.
    #[inline(always)]
    pub fn set_joint_sums<L: Lane<Real = T>>(&mut self, layout: &Layout, sums: &JointSums<L>) {
        if T::SINGLE {
            self.set_some(layout.q_rest, &sums.rest, layout.joints);
        }
    }
}

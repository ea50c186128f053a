//! Trees: what the passes carry to joints that branch off an earlier body, and back.

#![allow(non_snake_case, reason = "twists carry their usual symbol")]

use std::hint::black_box;

use super::link::LinkScratch;
use super::place::WaterFrame;
use crate::lane::Lane;
use crate::lie::{Vector3, Vector6};
use crate::spatial::SpatialInertia;
use crate::system::{JOINTS, JointTerms, WORLD};

/// Entry of the body that carries a joint which does not start at the body before it: `world`, `vehicle` or the entry of that
/// link.
#[inline(always)]
pub(super) fn at_carrier<T: Copy>(carrier: u8, world: T, vehicle: T, links: &[T]) -> T {
    match (carrier as usize).checked_sub(1) {
        Some(k) if k < links.len() => links[k],
        None => vehicle,
        _ => world,
    }
}

/// [`at_carrier`] of gravity and twist relative to the water, from the links that carry branches.
#[inline(always)]
pub(super) fn motion_at_carrier<L: Lane>(
    carrier: u8,
    (water, elapsed): (&WaterFrame<L>, L),
    vehicle: (Vector3<L>, Vector6<L>),
    links: &[LinkScratch<L>],
) -> (Vector3<L>, Vector6<L>) {
    match (carrier as usize).checked_sub(1) {
        Some(k) if k < links.len() => (links[k].g, links[k].V),
        None => vehicle,
        _ => (water.gravity, water.world_twist(elapsed)),
    }
}

/// [`at_carrier`] of the rate of the twist, from the links that carry branches.
#[inline(always)]
pub(super) fn rate_at_carrier<L: Lane>(
    carrier: u8,
    water: &WaterFrame<L>,
    vehicle: Vector6<L>,
    links: &[LinkScratch<L>],
) -> Vector6<L> {
    match (carrier as usize).checked_sub(1) {
        Some(k) if k < links.len() => links[k].V,
        None => vehicle,
        _ => water.world_rate(),
    }
}

/// Adds the wrench of a branch to the wrench p of its carrier.
#[inline(always)]
pub(super) fn add_to_carrier<L: Lane>(
    carrier: u8,
    wrench: Vector6<L>,
    vehicle: &mut Vector6<L>,
    links: &mut [LinkScratch<L>],
) {
    let p = match (carrier as usize).checked_sub(1) {
        Some(k) if k < links.len() => &mut links[k].p,
        Some(k) if k + 1 == WORLD as usize => return,
        _ => vehicle,
    };
    *p = *p + wrench;
}

/// Sums of what branches add to the bodies that carry them: entry 0 of the vehicle, k + 1 of the link of joint k.
#[derive(Debug, Clone)]
pub(crate) struct Branches<L>([(SpatialInertia<L>, Vector6<L>); JOINTS + 1]);

impl<L: Lane> Branches<L> {
    /// Zeros.
    #[inline(always)]
    pub fn new() -> Self {
        Self([black_box((SpatialInertia::zero(), Vector6::zero())); JOINTS + 1])
    }

    /// Sets the sums of the bodies that carry branches to 0.
    #[inline(always)]
    pub fn clear<P, B>(&mut self, joints: &[JointTerms<P, B>]) {
        let zero = stored_zero();
        for i in 0..=joints.len().min(JOINTS) {
            let carries = match i.checked_sub(1) {
                Some(k) => k < joints.len() && joints[k].branch.forks,
                None => true,
            };
            if let (true, Some((inertia, p))) = (carries, self.0.get_mut(i)) {
                fill(zero, inertia, p);
            }
        }
    }

    /// Moves inertia and bias wrench of a branch to the sum of its carrier, and leaves 0. The world takes them without an effect.
    #[inline(always)]
    pub fn add(&mut self, carrier: u8, inertia: &mut SpatialInertia<L>, p: &mut Vector6<L>) {
        if let Some((sum, wrench)) = self.0.get_mut(carrier as usize) {
            sum.add(inertia);
            *wrench = *wrench + *p;
        }
        fill(stored_zero(), inertia, p);
    }

    /// Adds the sum of the branches on a body.
    #[inline(always)]
    pub fn take(&self, body: usize, inertia: &mut SpatialInertia<L>, p: &mut Vector6<L>) {
        if let Some((sum, wrench)) = self.0.get(body) {
            inertia.add(sum);
            *p = *p + *wrench;
        }
    }
}

/// Zero that the compiler does not know: it would call `memset` in the kernels.
#[inline(always)]
pub(super) fn stored_zero<L: Lane>() -> L {
    black_box(L::zero())
}

/// Sets all numbers.
#[inline(always)]
pub(super) fn fill<L: Lane>(value: L, inertia: &mut SpatialInertia<L>, p: &mut Vector6<L>) {
    (inertia.m, inertia.h, inertia.j) = ([value; 6], [[value; 3]; 3], [value; 6]);
    (p.linear.0, p.angular.0) = ([value; 3], [value; 3]);
}

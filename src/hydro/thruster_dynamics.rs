//! Thrusts over steps: their state, and parabolas in the share of a step that has passed.

use super::thruster::{LagDecay, THRUSTERS, Thruster};
use crate::lane::{Lane, Param, unroll};
use crate::lie::Vector6;

/// State of the thrusters of a lane of instances during the steps of a call.
#[derive(Debug, Clone, Copy)]
pub struct ThrusterDynamics<L> {
    /// Thrust in still water, N: the state variable.
    pub thrust: [L; THRUSTERS],
    pub(super) steady: [L; THRUSTERS],
    pub(super) decay: [LagDecay<L>; THRUSTERS],
}

impl<L: Lane> ThrusterDynamics<L> {
    /// Zeros, to be overwritten.
    #[inline(always)]
    pub fn blank() -> Self {
        let zero = L::zero();
        Self {
            thrust: [zero; THRUSTERS],
            steady: [zero; THRUSTERS],
            decay: [LagDecay { start: zero, mean: zero, end: zero, after: zero }; THRUSTERS],
        }
    }

    /// Sets commands for steps of size `h`, with gains on the thrusts and the factor `lag` on the time constants.
    #[inline(always)]
    pub fn command<P: Param<L>>(
        &mut self,
        thrusters: &[Thruster<P>],
        commands: &[L; THRUSTERS],
        gains: &[L; THRUSTERS],
        (h, lag): (L, L),
    ) {
        for (i, thruster) in thrusters.iter().enumerate().take(THRUSTERS) {
            self.steady[i] = thruster.steady(commands[i]) * gains[i];
            self.decay[i] = thruster.lag_decay(h, lag);
        }
    }

    /// Advances the thrusts by one step. Returns their wrench over the step, of thrusters without loss by inflow.
    #[inline(always)]
    pub fn step<P: Param<L>>(&mut self, thrusters: &[Thruster<P>]) -> ThrustProfile<L> {
        let (mut start, mut mean, mut end) = ([L::zero(); 6], [L::zero(); 6], [L::zero(); 6]);
        for (i, thruster) in thrusters.iter().enumerate().take(THRUSTERS) {
            let ([first, middle, last], after) = self.decay[i].step(self.thrust[i], self.steady[i]);
            self.thrust[i] = after;
            unroll!(k in 0 1 2 3 4 5 => {
                let wrench = thruster.wrench[k].get();
                start[k] = first.mul_add(wrench, start[k]);
                mean[k] = middle.mul_add(wrench, mean[k]);
                end[k] = last.mul_add(wrench, end[k]);
            });
        }
        ThrustProfile::new(Vector6::from_array(start), Vector6::from_array(mean), Vector6::from_array(end))
    }

    /// Advances the thrusts of `count` thrusters by one step, and sets their courses over it.
    #[inline(always)]
    pub fn step_courses(&mut self, count: usize, courses: &mut ThrustProfiles<L>) {
        for i in 0..count.min(THRUSTERS) {
            let (values, after) = self.decay[i].step(self.thrust[i], self.steady[i]);
            self.thrust[i] = after;
            courses.set(i, values);
        }
    }

    /// Acting thrusts at this instant, N; thrusters without lag are steady.
    #[inline(always)]
    pub fn acting<P: Param<L>>(&self, thrusters: &[Thruster<P>], twist: Vector6<L>) -> [L; THRUSTERS] {
        let mut acting = [L::zero(); THRUSTERS];
        for (i, thruster) in thrusters.iter().enumerate().take(THRUSTERS) {
            let now = if thruster.lag.is_some() { self.thrust[i] } else { self.steady[i] };
            acting[i] = thruster.acting(now, twist);
        }
        acting
    }

    /// Acting thrusts in the steady state, N.
    #[inline(always)]
    pub fn settled<P: Param<L>>(&self, thrusters: &[Thruster<P>], twist: Vector6<L>) -> [L; THRUSTERS] {
        let settled = Self { thrust: self.steady, ..*self };
        settled.acting(thrusters, twist)
    }
}

/// Wrench of thrusters over a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThrustProfile<L> {
    /// Wrench at the start, N and N m.
    pub start: Vector6<L>,
    linear: Vector6<L>,
    quadratic: Vector6<L>,
}

impl<L: Lane> ThrustProfile<L> {
    /// Parabola with these values at the start and at the end and this mean: the impulse over the step is exact, and the wrench
    /// within it to order 3.
    #[inline(always)]
    fn new(start: Vector6<L>, mean: Vector6<L>, end: Vector6<L>) -> Self {
        let (before, after) = (mean - start, end - mean);
        let three = L::c(3.0);
        Self {
            start,
            linear: before.scale_add(L::c(4.0), after.scale(L::c(-2.0))),
            quadratic: after.scale(three) - before.scale(three),
        }
    }

    /// Difference from the start at a share of the step.
    #[inline(always)]
    pub fn change(&self, share: L) -> Vector6<L> {
        self.quadratic.scale_add(share, self.linear).scale(share)
    }
}

/// Thrusts in still water over a step, N: of each thruster a parabola, constant term first. Where inflow takes part of the thrust
/// that part is the stage's, so that the sum of their wrenches is no parabola.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThrustProfiles<L>([[L; 3]; THRUSTERS]);

impl<L: Lane> ThrustProfiles<L> {
    /// Zeros.
    #[inline(always)]
    pub fn zero() -> Self {
        Self([[L::zero(); 3]; THRUSTERS])
    }

    /// Sets the parabola of a thruster, as [`ThrustProfile::new`].
    #[inline(always)]
    fn set(&mut self, thruster: usize, [start, mean, end]: [L; 3]) {
        let (before, after, three) = (mean - start, end - mean, L::c(3.0));
        let linear = before.mul_add(L::c(4.0), after * L::c(-2.0));
        self.0[thruster] = [start, linear, after * three - before * three];
    }

    #[inline(always)]
    pub(super) fn at(&self, thruster: usize, share: L) -> L {
        let [start, linear, quadratic] = self.0[thruster];
        quadratic.mul_add(share, linear).mul_add(share, start)
    }

    /// Wrench on the vehicle at a share of the step, at the relative twist of that moment.
    #[inline(always)]
    pub fn wrench<P: Param<L>>(&self, thrusters: &[Thruster<P>], share: L, twist: Vector6<L>) -> Vector6<L> {
        let mut wrench = [L::zero(); 6];
        for (i, thruster) in thrusters.iter().enumerate().take(THRUSTERS) {
            let thrust = thruster.acting(self.at(i, share), twist);
            unroll!(k in 0 1 2 3 4 5 => {
                wrench[k] = thrust.mul_add(thruster.wrench[k].get(), wrench[k]);
            });
        }
        Vector6::from_array(wrench)
    }
}

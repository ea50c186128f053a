//! Adjoint of thruster dynamics; of map, inflow and decay by dual numbers.

use super::thruster::{LagDecay, THRUSTERS, Thruster};
use super::thruster_dynamics::{ThrustProfiles, ThrusterDynamics};
use crate::lane::{Dual, Lane, unroll};
use crate::lie::Vector6;

/// Cotangents of thrusters during the steps of a call.
#[derive(Debug, Clone, Copy)]
pub struct ThrusterCotangents<L> {
    /// Cotangent of the thrust in still water.
    pub thrust: [L; THRUSTERS],
    steady: [L; THRUSTERS],
    decay: [LagDecay<L>; THRUSTERS],
}

/// Cotangents of commands, of gains on the thrusts and of the factor on the time constants.
#[derive(Debug, Clone, Copy)]
pub struct CommandCotangents<L> {
    /// Cotangent of the commands.
    pub commands: [L; THRUSTERS],
    /// Cotangent of the gains.
    pub gains: [L; THRUSTERS],
    /// Cotangent of the factor.
    pub lag: L,
}

/// Cotangents of the wrench over a step: of its start, and of linear and quadratic term of its change.
pub type CourseCotangents<L> = [Vector6<L>; 3];

/// Cotangents of the thrusts over a step, in the order of [`super::ThrustProfiles`].
#[derive(Debug, Clone, Copy)]
pub struct ThrustCotangents<L>([[L; 3]; THRUSTERS]);

impl<L: Lane> ThrustCotangents<L> {
    /// Zeros.
    #[inline(always)]
    pub fn zero() -> Self {
        Self([[L::zero(); 3]; THRUSTERS])
    }

    /// Adds the cotangent of the thrust at a share of the step.
    #[inline(always)]
    pub(super) fn add(&mut self, thruster: usize, share: L, of: L) {
        let [start, linear, quadratic] = &mut self.0[thruster];
        *start += of;
        *linear = of.mul_add(share, *linear);
        *quadratic = (of * share).mul_add(share, *quadratic);
    }

    /// Cotangents of a thrust at the start, on average and at the end: the values that give its parabola.
    #[inline(always)]
    fn of_values(&self, thruster: usize) -> [L; 3] {
        let [start, linear, quadratic] = self.0[thruster];
        let [three, six] = [3.0, 6.0].map(L::c);
        [
            quadratic.mul_add(three, linear.mul_add(L::c(-4.0), start)),
            (linear - quadratic) * six,
            quadratic.mul_add(three, linear * L::c(-2.0)),
        ]
    }
}

impl<L: Lane> ThrustProfiles<L> {
    /// Cotangent of the twist from the cotangent of [`Self::wrench`]; adds the cotangents of the parabolas.
    #[inline(always)]
    pub fn wrench_adjoint(
        &self,
        thrusters: &[Thruster<L>],
        share: L,
        twist: Vector6<L>,
        of: Vector6<L>,
        of_courses: &mut ThrustCotangents<L>,
    ) -> Vector6<L> {
        let (zero, one) = (L::zero(), L::c(1.0));
        let mut of_twist = Vector6::zero();
        for (i, thruster) in thrusters.iter().enumerate().take(THRUSTERS) {
            let along = Vector6::from_array(thruster.along);
            let (thrust, speed) = (self.at(i, share), along.dot(twist));
            let by_thrust = thruster.reduced(Dual::new(thrust, one), Dual::new(speed, zero)).slope;
            let by_speed = thruster.reduced(Dual::new(thrust, zero), Dual::new(speed, one)).slope;
            let of = Vector6::from_array(thruster.wrench).dot(of);
            of_twist = along.scale_add(of * by_speed, of_twist);
            of_courses.add(i, share, of * by_thrust);
        }
        of_twist
    }
}

impl<L: Lane> ThrusterCotangents<L> {
    /// Zeros.
    #[inline(always)]
    pub fn zero() -> Self {
        let zero = L::zero();
        let decay = LagDecay { start: zero, mean: zero, end: zero, after: zero };
        Self { thrust: [zero; THRUSTERS], steady: [zero; THRUSTERS], decay: [decay; THRUSTERS] }
    }
}

impl<L: Lane> ThrusterDynamics<L> {
    /// Reverse of a step from these thrusts on, by the cotangents of wrench and thrusts over it: replaces the cotangents of the
    /// thrusts after the step by the cotangents of the thrusts before it.
    #[inline(always)]
    pub fn step_adjoint(
        &self,
        thrusters: &[Thruster<L>],
        thrusts: &[L; THRUSTERS],
        [start, linear, quadratic]: CourseCotangents<L>,
        of_thrusts: &ThrustCotangents<L>,
        of: &mut ThrusterCotangents<L>,
    ) {
        let [three, six] = [3.0, 6.0].map(L::c);
        // As of the values of the parabola: see `ThrustProfile`.
        let of_start = quadratic.scale_add(three, linear.scale_add(L::c(-4.0), start));
        let of_mean = (linear - quadratic).scale(six);
        let of_end = quadratic.scale_add(three, linear.scale(L::c(-2.0)));
        let of_wrenches = [of_start, of_mean, of_end];
        for (i, thruster) in thrusters.iter().enumerate().take(THRUSTERS) {
            let (steady, decay) = (self.steady[i], &self.decay[i]);
            let shares = [decay.start, decay.mean, decay.end];
            let wrench = Vector6::from_array(thruster.wrench);
            let (mut of_difference, mut of_steady) = (of.thrust[i] * decay.after, of.thrust[i]);
            let mut of_values = of_thrusts.of_values(i);
            unroll!(k in 0 1 2 => {
                of_values[k] += wrench.dot(of_wrenches[k]);
                of_difference = of_values[k].mul_add(shares[k], of_difference);
                of_steady += of_values[k];
            });
            let difference = thrusts[i] - steady;
            let of_decay = &mut of.decay[i];
            of_decay.start = difference.mul_add(of_values[0], of_decay.start);
            of_decay.mean = difference.mul_add(of_values[1], of_decay.mean);
            of_decay.end = difference.mul_add(of_values[2], of_decay.end);
            of_decay.after = difference.mul_add(of.thrust[i], of_decay.after);
            of.thrust[i] = of_difference;
            of.steady[i] = of.steady[i] + of_steady - of_difference;
        }
    }

    /// Cotangents of commands, gains and lag from the cotangents of the steps: see [`ThrusterDynamics::command`].
    #[inline(always)]
    pub fn command_adjoint(
        &self,
        thrusters: &[Thruster<L>],
        commands: &[L; THRUSTERS],
        gains: &[L; THRUSTERS],
        (h, lag): (L, L),
        of: &ThrusterCotangents<L>,
    ) -> CommandCotangents<L> {
        let (zero, one) = (L::zero(), L::c(1.0));
        let mut sums = CommandCotangents { commands: [zero; THRUSTERS], gains: [zero; THRUSTERS], lag: zero };
        for (i, thruster) in thrusters.iter().enumerate().take(THRUSTERS) {
            let steady = thruster.steady(Dual::new(commands[i], one));
            sums.commands[i] = of.steady[i] * gains[i] * steady.slope;
            sums.gains[i] = of.steady[i] * steady.value;
            let (decay, of): (LagDecay<Dual<L>>, _) =
                (thruster.lag_decay(Dual::new(h, zero), Dual::new(lag, one)), &of.decay[i]);
            sums.lag += decay.start.slope * of.start + decay.mean.slope * of.mean;
            sums.lag += decay.end.slope * of.end + decay.after.slope * of.after;
        }
        sums
    }
}

//! Adjoint of thruster dynamics; of map, inflow and decay by dual numbers.

use super::thruster::{LagDecay, THRUSTERS, Thruster, ThrusterDynamics};
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
    /// Cotangent of the twist from those of the wrench of [`ThrusterDynamics::step`] from these thrusts on; those of the thrusts after
    /// the step become those before it.
    #[inline(always)]
    pub fn step_adjoint(
        &self,
        thrusters: &[Thruster<L>],
        thrusts: &[L; THRUSTERS],
        twist: Vector6<L>,
        [start, linear, quadratic]: CourseCotangents<L>,
        of: &mut ThrusterCotangents<L>,
    ) -> Vector6<L> {
        let (zero, one) = (L::zero(), L::c(1.0));
        let [three, six] = [3.0, 6.0].map(L::c);
        // As of the values of the parabola: see `ThrustCourse`.
        let of_start = quadratic.scale_add(three, linear.scale_add(L::c(-4.0), start));
        let of_mean = (linear - quadratic).scale(six);
        let of_end = quadratic.scale_add(three, linear.scale(L::c(-2.0)));
        let of_values = [of_start, of_mean, of_end];
        let mut of_twist = Vector6::zero();
        for (i, thruster) in thrusters.iter().enumerate().take(THRUSTERS) {
            let (steady, decay) = (self.steady[i], &self.decay[i]);
            let (values, _) = decay.step(thrusts[i], steady);
            let shares = [decay.start, decay.mean, decay.end];
            let (along, wrench) = (Vector6::from_array(thruster.along), Vector6::from_array(thruster.wrench));
            let speed = along.dot(twist);
            let (mut of_difference, mut of_steady, mut of_speed) = (of.thrust[i] * decay.after, of.thrust[i], zero);
            let mut of_shares = [zero; 3];
            unroll!(k in 0 1 2 => {
                let of_value = wrench.dot(of_values[k]);
                let by_value = thruster.reduced(Dual::new(values[k], one), Dual::new(speed, zero)).slope;
                let by_speed = thruster.reduced(Dual::new(values[k], zero), Dual::new(speed, one)).slope;
                of_speed = of_value.mul_add(by_speed, of_speed);
                let of_value = of_value * by_value;
                of_difference = of_value.mul_add(shares[k], of_difference);
                of_steady += of_value;
                of_shares[k] = of_value;
            });
            of_twist = along.scale_add(of_speed, of_twist);
            let difference = thrusts[i] - steady;
            let of_decay = &mut of.decay[i];
            of_decay.start = difference.mul_add(of_shares[0], of_decay.start);
            of_decay.mean = difference.mul_add(of_shares[1], of_decay.mean);
            of_decay.end = difference.mul_add(of_shares[2], of_decay.end);
            of_decay.after = difference.mul_add(of.thrust[i], of_decay.after);
            of.thrust[i] = of_difference;
            of.steady[i] = of.steady[i] + of_steady - of_difference;
        }
        of_twist
    }

    /// Cotangents of commands, gains and lag from those of the steps: see [`ThrusterDynamics::command`].
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

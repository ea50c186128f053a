//! Thruster dynamics: static map, first-order lag, loss by inflow.
//!
//! Limits, dead band and map give the steady thrust of a command in still water; the thrust T follows with a first-order lag;
//! inflow along the thrust reduces it `[KC06]`:
//!
//! ```text
//! tau T' = map(command) - T        T_acting = sign(T) max(0, |T| - k sqrt(|T|) s),    s = max(0, sign(T) e . v_r)
//! ```
//!
//! with the velocity v_r of the thruster through the water and its axis e. Kim and Chung write `T = rho D^4 K_T n |n|` with K_T a
//! parabola in the advance ratio `J = s / (n D)`. The linear term is kept, with n from the thrust in still water
//! (`|T| = rho D^4 K_T(0) n^2`), and the thrust is bounded by 0. For flow against the thrust (their anti- and
//! vague-directional states) it is the thrust in still water.

use crate::lane::{Lane, Param, get_all, horner, numbers, unroll};
use crate::lie::Vector6;

/// Maximum number of thrusters.
pub const THRUSTERS: usize = 16;

/// One number per thruster; entries past the vehicle's are 0.
pub type Thrusts = [f64; THRUSTERS];

numbers! {
    /// A thruster with dynamics.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Thruster<P> {
        /// Wrench on the vehicle per newton of thrust: column of T_tcm.
        pub wrench: [P; 6],
        /// Row that maps the vehicle's twist to the speed along the axis.
        pub along: [P; 6],
        /// Minimum and maximum command and thrust, N.
        pub limits: [P; 2],
        /// Time constant, s.
        pub lag: Option<P>,
        /// Commands within this range give no thrust, N.
        pub dead_band: Option<[P; 2]>,
        /// Map of commands outside the dead band: positive and negative branch.
        pub map: Option<[Branch<P>; 2]>,
        /// Loss coefficient k of the inflow, N^(1/2) s/m.
        pub ambient_flow: Option<P>,
    }
}

numbers! {
    /// Branch of a piecewise linear map: commands and thrusts of one sign.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Branch<P> {
        /// Thrust at its beginning, N.
        pub base: P,
        /// Pieces, outward: magnitude of the command at the beginning, length, slope.
        pub pieces: Vec<[P; 3]>,
    }
}

impl<P: Copy> Branch<P> {
    /// Thrust for a command of this magnitude, N.
    #[inline(always)]
    fn at<L: Lane>(&self, size: L) -> L
    where
        P: Param<L>,
    {
        let mut thrust = self.base.get();
        for [start, length, slope] in &self.pieces {
            // Dual numbers have the slope of the second operand where both are equal: outward at the beginning of a piece.
            let within = L::zero().max(size - start.get()).min(length.get());
            thrust = slope.get().mul_add(within, thrust);
        }
        thrust
    }
}

impl<P: Copy> Thruster<P> {
    /// Steady thrust of a command in still water, N.
    #[inline(always)]
    pub fn steady<L: Lane>(&self, command: L) -> L
    where
        P: Param<L>,
    {
        let [lower, upper]: [L; 2] = get_all(&self.limits);
        let command = command.min(upper).max(lower);
        let mut thrust = command;
        if let Some([up, down]) = &self.map {
            // Not `abs`: its slope at 0 is 0.
            let forward = L::zero().lt(command);
            let size = L::select(forward, command, -command);
            thrust = L::select(forward, up.at(size), -down.at(size)).min(upper).max(lower);
        }
        if let Some(band) = &self.dead_band {
            let [from, to]: [L; 2] = get_all(band);
            thrust = L::select(to.lt(command), thrust, L::select(command.lt(from), thrust, L::zero()));
        }
        thrust
    }

    /// Thrust reduced by the inflow at the vehicle's relative twist, N. `[KC06]`
    #[inline(always)]
    pub fn acting<L: Lane>(&self, thrust: L, twist: Vector6<L>) -> L
    where
        P: Param<L>,
    {
        if self.ambient_flow.is_none() {
            return thrust;
        }
        self.reduced(thrust, Vector6::from_array(get_all(&self.along)).dot(twist))
    }

    /// Thrust reduced by the inflow at this speed along the axis, N.
    #[inline(always)]
    pub(super) fn reduced<L: Lane>(&self, thrust: L, speed: L) -> L
    where
        P: Param<L>,
    {
        let Some(k) = self.ambient_flow else { return thrust };
        let forward = L::zero().lt(thrust);
        // As in `steady` and `Branch::at`: a thrust of 0 has the slope of still water.
        let size = L::select(forward, thrust, -thrust);
        let inflow = L::select(forward, speed, -speed).max(L::zero());
        let reduced = L::zero().max((k.get() * size.sqrt()).neg_mul_add(inflow, size));
        L::select(forward, reduced, -reduced)
    }

    /// Decay of the lag over a step of size h, with a factor on the time constant.
    #[inline(always)]
    pub fn lag_decay<L: Lane>(&self, h: L, factor: L) -> LagDecay<L>
    where
        P: Param<L>,
    {
        let zero = L::zero();
        let Some(lag) = self.lag else { return LagDecay { start: zero, mean: zero, end: zero, after: zero } };
        let x = h / (lag.get() * factor);
        let decayed = one_minus_exp(x);
        let (mean, after, slow) = (decayed / x, L::c(1.0) - decayed, x.lt(L::c(1.0)));
        LagDecay { start: L::select(slow, L::c(1.0), mean), mean, end: L::select(slow, after, mean), after }
    }
}

/// Remainder of the difference between a lagging thrust and its steady value over a step: as it acts at the start and at the end,
/// on average, and at the end. A lag that is shorter than the step acts with its mean. Without lag nothing remains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LagDecay<L> {
    /// Remainder that acts at the start.
    pub start: L,
    /// Mean remainder, `(1 - exp(-h / tau)) tau / h`.
    pub mean: L,
    /// Remainder that acts at the end.
    pub end: L,
    /// Remainder after the step, `exp(-h / tau)`.
    pub after: L,
}

/// Difference from the steady thrust that counts as 0, N: the exponential never reaches it.
const SETTLED: f64 = 1e-20;

impl<L: Lane> LagDecay<L> {
    /// Exact solution over a step from `thrust` towards the steady thrust: as it acts at the start, on average and at the end, and the
    /// thrust after it.
    #[inline(always)]
    pub fn step(&self, thrust: L, steady: L) -> ([L; 3], L) {
        let difference = thrust - steady;
        // 0 where it is settled, by a subtraction that leaves dual numbers their slope.
        let settled = L::select(difference.abs().lt(L::c(SETTLED)), difference.constant(), L::zero());
        let difference = difference - settled;
        let acting = [
            difference.mul_add(self.start, steady),
            difference.mul_add(self.mean, steady),
            difference.mul_add(self.end, steady),
        ];
        (acting, difference.mul_add(self.after, steady))
    }
}

/// Exponent beyond which the exponential is 0 to rounding.
const MAX_EXPONENT: f64 = 40.0;
/// Halvings that reduce exponents below 0.65.
const HALVINGS: i32 = 6;
/// Taylor coefficients of `(exp(y) - 1) / y` on that range.
const EXP: [f64; 14] = {
    let mut terms = [1.0; 14];
    let mut k = 1;
    while k < 14 {
        terms[k] = terms[k - 1] / (k as f64 + 1.0);
        k += 1;
    }
    terms
};

/// `1 - exp(-x)` for x > 0, accurate for small x.
#[inline(always)]
fn one_minus_exp<L: Lane>(x: L) -> L {
    let y = x.min(L::c(MAX_EXPONENT)) * L::c(-0.5_f64.powi(HALVINGS));
    let mut e = y * horner(y, &EXP);
    for _ in 0..HALVINGS {
        // exp(2 y) - 1 = (exp y - 1) (exp y + 1)
        e = e * (e + L::c(2.0));
    }
    L::select(x.lt(L::c(MAX_EXPONENT)), -e, L::c(1.0))
}

/// Wrench of acting thrusts, vehicle frame.
#[inline(always)]
pub fn thrust_wrench<L: Lane, P: Param<L>>(thrusters: &[Thruster<P>], thrusts: &[L; THRUSTERS]) -> Vector6<L> {
    let mut wrench = [L::zero(); 6];
    for (i, thruster) in thrusters.iter().enumerate().take(THRUSTERS) {
        unroll!(k in 0 1 2 3 4 5 => {
            wrench[k] = thrusts[i].mul_add(thruster.wrench[k].get(), wrench[k]);
        });
    }
    Vector6::from_array(wrench)
}

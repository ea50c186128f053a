//! Thrusters that do not give what they are asked for at once: static map, lag, inflow.
//!
//! A command goes through limits, dead band and map to the thrust T that it settles at in still water; a first-order lag
//! leads there; and water that flows in along the thrust takes some of it away `[KC06]`:
//!
//! ```text
//! tau T' = map(command) - T        T_acting = sign(T) max(0, |T| - k sqrt(|T|) s),    s = max(0, sign(T) e . v_r)
//! ```
//!
//! with the velocity v_r of the thruster through the water and its axis e. Kim and Chung write `T = rho D^4 K_T n |n|` with K_T a
//! parabola in the advance ratio `J = s / (n D)`; its linear term is kept, n taken from the thrust at rest
//! (`|T| = rho D^4 K_T(0) n^2`), and the thrust ends where it would turn. Against the thrust (their anti- and
//! vague-directional states) it is as in still water.

use crate::lane::{Lane, Param, get_all, horner};
use crate::lie::Vector6;

/// Greatest number of thrusters.
pub const THRUSTERS: usize = 16;

/// One number per thruster; entries past the vehicle's are 0.
pub type Thrusts = [f64; THRUSTERS];

/// A thruster with dynamics.
#[derive(Debug, Clone, PartialEq)]
pub struct Thruster<P> {
    /// Wrench on the vehicle per thrust: column of T_tcm.
    pub wrench: [P; 6],
    /// Speed along the axis per twist of the vehicle.
    pub along: [P; 6],
    /// Least and greatest command, and thrust, N.
    pub limits: [P; 2],
    /// Time constant, s.
    pub lag: Option<P>,
    /// Commands within give no thrust.
    pub dead_band: Option<[P; 2]>,
    /// Thrust of commands beyond it: upward and downward.
    pub map: Option<[Branch<P>; 2]>,
    /// k of the inflow.
    pub ambient_flow: Option<P>,
}

/// Half of a piecewise linear map: commands and thrusts of one sign.
#[derive(Debug, Clone, PartialEq)]
pub struct Branch<P> {
    /// Thrust where it begins.
    pub base: P,
    /// Pieces from there outward: magnitude of the command where it begins, length, thrust per command.
    pub pieces: Vec<[P; 3]>,
}

impl<P: Copy> Branch<P> {
    fn map<Q>(&self, change: &impl Fn(P) -> Q) -> Branch<Q> {
        Branch { base: change(self.base), pieces: self.pieces.iter().map(|piece| piece.map(change)).collect() }
    }

    /// Thrust of a command of this magnitude.
    #[inline(always)]
    fn at<L: Lane>(&self, size: L) -> L
    where
        P: Param<L>,
    {
        let mut thrust = self.base.get();
        for [start, length, slope] in &self.pieces {
            let within = (size - start.get()).max(L::zero()).min(length.get());
            thrust = slope.get().mul_add(within, thrust);
        }
        thrust
    }
}

impl<P: Copy> Thruster<P> {
    /// The same with each number changed.
    pub fn map<Q>(&self, change: impl Fn(P) -> Q) -> Thruster<Q> {
        let c = &change;
        Thruster {
            wrench: self.wrench.map(c),
            along: self.along.map(c),
            limits: self.limits.map(c),
            lag: self.lag.map(c),
            dead_band: self.dead_band.map(|band| band.map(c)),
            map: self.map.as_ref().map(|branches| branches.each_ref().map(|branch| branch.map(c))),
            ambient_flow: self.ambient_flow.map(c),
        }
    }

    /// Thrust that a command settles at in still water, N.
    #[inline(always)]
    pub fn steady<L: Lane>(&self, command: L) -> L
    where
        P: Param<L>,
    {
        let [lower, upper]: [L; 2] = get_all(&self.limits);
        let command = command.min(upper).max(lower);
        let mut thrust = command;
        if let Some([up, down]) = &self.map {
            let size = command.abs();
            thrust = L::select(L::zero().lt(command), up.at(size), -down.at(size)).min(upper).max(lower);
        }
        if let Some(band) = &self.dead_band {
            let [from, to]: [L; 2] = get_all(band);
            thrust = L::select(to.lt(command), thrust, L::select(command.lt(from), thrust, L::zero()));
        }
        thrust
    }

    /// What is left of a thrust at a twist of the vehicle through the water, N. `[KC06]`
    #[inline(always)]
    pub fn acting<L: Lane>(&self, thrust: L, twist: Vector6<L>) -> L
    where
        P: Param<L>,
    {
        let Some(k) = self.ambient_flow else { return thrust };
        let speed = Vector6::from_array(get_all(&self.along)).dot(twist);
        let forward = L::zero().lt(thrust);
        let (size, inflow) = (thrust.abs(), L::select(forward, speed, -speed).max(L::zero()));
        let left = (k.get() * size.sqrt()).neg_mul_add(inflow, size).max(L::zero());
        L::select(forward, left, -left)
    }

    /// What a step of size h does to the lag, whose time constant has a factor.
    #[inline(always)]
    pub fn lag_decay<L: Lane>(&self, h: L, factor: L) -> LagDecay<L>
    where
        P: Param<L>,
    {
        let Some(lag) = self.lag else { return LagDecay { kept: L::zero(), mean: L::zero() } };
        let x = h / (lag.get() * factor);
        let gone = one_less_exp(x);
        LagDecay { kept: L::c(1.0) - gone, mean: gone / x }
    }
}

/// Of the distance of a lagging thrust from where it settles: what is left after a step, and its mean over the step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LagDecay<L> {
    /// `exp(-h / tau)`
    pub kept: L,
    /// `(1 - exp(-h / tau)) tau / h`
    pub mean: L,
}

/// Distance from where it settles at which a thrust counts as there, N: it would never get there, only ever closer.
const THERE: f64 = 1e-20;

impl<L: Lane> LagDecay<L> {
    /// Takes a thrust over a step towards where it settles: its mean over the step, and what it is afterwards. Exact.
    #[inline(always)]
    pub fn step(&self, thrust: L, settles: L) -> (L, L) {
        let far = thrust - settles;
        let far = L::select(far.abs().lt(L::c(THERE)), L::zero(), far);
        (far.mul_add(self.mean, settles), far.mul_add(self.kept, settles))
    }
}

/// Exponents from which on nothing is left.
const GONE: f64 = 40.0;
/// Halvings that bring these below 0.65, and back.
const HALVINGS: i32 = 6;
/// `(exp(y) - 1) / y` on that range: its Taylor polynomial.
const EXP: [f64; 14] = {
    let mut terms = [1.0; 14];
    let mut k = 1;
    while k < 14 {
        terms[k] = terms[k - 1] / (k as f64 + 1.0);
        k += 1;
    }
    terms
};

/// `1 - exp(-x)` for x > 0, without loss where x is small.
#[inline(always)]
fn one_less_exp<L: Lane>(x: L) -> L {
    let y = x.min(L::c(GONE)) * L::c(-0.5_f64.powi(HALVINGS));
    let mut e = y * horner(y, &EXP);
    for _ in 0..HALVINGS {
        // exp(2 y) - 1 = (exp y - 1) (exp y + 1)
        e = e * (e + L::c(2.0));
    }
    L::select(x.lt(L::c(GONE)), -e, L::c(1.0))
}

/// Thrusters of a group of instances over the steps of a call.
#[derive(Debug, Clone, Copy)]
pub struct ThrusterDynamics<L> {
    /// Thrust in still water, N: the state.
    pub thrust: [L; THRUSTERS],
    settles: [L; THRUSTERS],
    decay: [LagDecay<L>; THRUSTERS],
}

impl<L: Lane> ThrusterDynamics<L> {
    /// Memory to load into.
    #[inline(always)]
    pub fn blank() -> Self {
        let zero = L::zero();
        Self {
            thrust: [zero; THRUSTERS],
            settles: [zero; THRUSTERS],
            decay: [LagDecay { kept: zero, mean: zero }; THRUSTERS],
        }
    }

    /// Takes commands for steps of size `h`, with gains on the thrusts and a factor on the time constants.
    #[inline(always)]
    pub fn command<P: Param<L>>(
        &mut self,
        thrusters: &[Thruster<P>],
        commands: &[L; THRUSTERS],
        gains: &[L; THRUSTERS],
        (h, lag): (L, L),
    ) {
        for (i, thruster) in thrusters.iter().enumerate().take(THRUSTERS) {
            self.settles[i] = thruster.steady(commands[i]) * gains[i];
            self.decay[i] = thruster.lag_decay(h, lag);
        }
    }

    /// Wrench of a step that begins with the vehicle's twist through the water, by the thrusts' means over the step; the
    /// thrusts then are those of its end.
    #[inline(always)]
    pub fn step<P: Param<L>>(&mut self, thrusters: &[Thruster<P>], twist: Vector6<L>) -> Vector6<L> {
        let mut wrench = [L::zero(); 6];
        for (i, thruster) in thrusters.iter().enumerate().take(THRUSTERS) {
            let (mean, after) = self.decay[i].step(self.thrust[i], self.settles[i]);
            self.thrust[i] = after;
            let acting = thruster.acting(mean, twist);
            for k in 0..6 {
                wrench[k] = acting.mul_add(thruster.wrench[k].get(), wrench[k]);
            }
        }
        Vector6::from_array(wrench)
    }

    /// Thrusts that act at this instant: those without lag have settled.
    #[inline(always)]
    pub fn acting<P: Param<L>>(&self, thrusters: &[Thruster<P>], twist: Vector6<L>) -> [L; THRUSTERS] {
        let mut acting = [L::zero(); THRUSTERS];
        for (i, thruster) in thrusters.iter().enumerate().take(THRUSTERS) {
            let now = if thruster.lag.is_some() { self.thrust[i] } else { self.settles[i] };
            acting[i] = thruster.acting(now, twist);
        }
        acting
    }

    /// Thrusts that would act if all had settled.
    #[inline(always)]
    pub fn settled<P: Param<L>>(&self, thrusters: &[Thruster<P>], twist: Vector6<L>) -> [L; THRUSTERS] {
        let settled = Self { thrust: self.settles, ..*self };
        settled.acting(thrusters, twist)
    }
}

/// Wrench of thrusts.
#[inline(always)]
pub fn thrust_wrench<L: Lane, P: Param<L>>(thrusters: &[Thruster<P>], thrusts: &[L; THRUSTERS]) -> Vector6<L> {
    let mut wrench = [L::zero(); 6];
    for (i, thruster) in thrusters.iter().enumerate().take(THRUSTERS) {
        for k in 0..6 {
            wrench[k] = thrusts[i].mul_add(thruster.wrench[k].get(), wrench[k]);
        }
    }
    Vector6::from_array(wrench)
}

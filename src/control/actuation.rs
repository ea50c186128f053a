//! Actions to thrusts, their wrench and joint torques, in lanes.

use nalgebra::Vector6 as Vector;

use super::action::{ActionKind, ActionMap};
use super::allocation::{ROUNDING, THRUSTERS};
use crate::lane::{Lane, Real};
use crate::lie::Vector6;
use crate::system::JOINTS;

/// Maximum number of entries of an action.
pub const ACTIONS: usize = THRUSTERS + JOINTS;

/// An [`ActionMap`] in the kernel's precision.
#[derive(Debug, Clone, PartialEq)]
pub struct Actuation<T> {
    kind: ActionKind,
    len: usize,
    thrusters: Vec<ThrusterTerms<T>>,
    /// True where a thruster has almost no thrust one way, so that rounding may exceed its limit there.
    one_sided: bool,
    /// Torque of 1, per actuated joint, N m or N; the joints' entries come last.
    torques: Vec<T>,
    /// Share of its torque limit from which a joint counts as saturated.
    near: T,
    /// 1 / number of thrusters and joints.
    share: T,
}

#[derive(Debug, Clone, PartialEq)]
struct ThrusterTerms<T> {
    /// Unsaturated thrust per entry of a wrench action, N.
    demand: [T; 6],
    /// Minimum and maximum thrust, N.
    limits: [T; 2],
    /// Their inverses; infinite for 0.
    inverse: [T; 2],
    /// Inverse of the maximum thrust in either direction; 0 for 0.
    relative: T,
    /// Magnitude from which a thrust counts as saturated, in either direction, N.
    full: [T; 2],
    wrench: [T; 6],
}

/// Share of its maximum thrust below which a limit is within rounding.
const ONE_SIDED: f64 = 1e-3;

impl<T: Real> ThrusterTerms<T> {
    /// A thrust over its limit.
    #[inline(always)]
    fn ratio<L: Lane<Real = T>>(&self, thrust: L) -> L {
        let [lower, upper] = self.inverse;
        (thrust * L::splat(upper)).max(thrust * L::splat(lower))
    }
}

/// Thrusts and torques of an action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Actuated<L> {
    /// Thrusts within their limits, N; 0 past the vehicle's thrusters.
    pub thrusts: [L; THRUSTERS],
    /// Their body wrench `T_tcm T` at the vehicle origin, N and N m. `[HC eq. 25]`
    pub wrench: Vector6<L>,
    /// Torques of the actuated joints, N m or N; 0 for all others.
    pub torques: [L; JOINTS],
    /// Mean square of the relative thrusts and torques `|T| / T_max`.
    pub square: L,
    /// Mean of their power 3/2, as shaft power grows with thrust.
    pub power: L,
    /// Share of saturated thrusters and joints.
    pub saturation: L,
}

impl<L: Lane> Actuated<L> {
    /// Zeros: memory to work in.
    #[inline(always)]
    pub fn none() -> Self {
        let zero = L::zero();
        let (thrusts, torques) = ([zero; THRUSTERS], [zero; JOINTS]);
        Self { thrusts, wrench: Vector6::zero(), torques, square: zero, power: zero, saturation: zero }
    }
}

impl<T: Real> Actuation<T> {
    /// The numbers of an action map.
    pub fn new(map: &ActionMap) -> Self {
        let allocation = map.allocation();
        let number = T::from_f64;
        let wrench_limits = Vector::from(allocation.wrench_limits());
        // Rounding leaves a full thrust a little short of its limit.
        let near = 1.0 - f64::max(1e-9, 4.0 * T::EPSILON);
        let minimum = if T::SINGLE { f64::from(f32::MIN_POSITIVE) } else { f64::MIN_POSITIVE };
        let thruster = |i: usize| {
            let ([lower, upper], range) = (allocation.limits(i), allocation.range(i));
            ThrusterTerms {
                demand: allocation.pseudo_inverse(i).component_mul(&wrench_limits).map(number).into(),
                limits: [lower, upper].map(number),
                inverse: [-1.0 / lower.abs(), 1.0 / upper.abs()].map(number),
                relative: number(if range > 0.0 { 1.0 / range } else { 0.0 }),
                full: [-lower, upper].map(|limit| number((near * limit).max(minimum))),
                wrench: allocation.column(i).map(number).into(),
            }
        };
        let (count, torques) = (allocation.count(), map.torques());
        Self {
            kind: map.kind(),
            len: map.len(),
            thrusters: (0..count).map(thruster).collect(),
            one_sided: (0..count)
                .any(|i| allocation.limits(i).into_iter().any(|x| x.abs() < ONE_SIDED * allocation.range(i))),
            torques: torques.iter().copied().map(number).collect(),
            near: number(near),
            share: number(1.0 / (count + torques.len()).max(1) as f64),
        }
    }

    /// Entries of an action.
    #[expect(clippy::len_without_is_empty, reason = "an action without entries is refused")]
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Number of thrusters.
    pub fn thrusters(&self) -> usize {
        self.thrusters.len()
    }

    /// Maximum ratio of a thrust to its limit, or 1 if that is more.
    #[inline(always)]
    fn excess<L: Lane<Real = T>>(&self, thrusts: &[L; THRUSTERS]) -> L {
        let (zero, one) = (L::zero(), L::c(1.0));
        let mut excess = one;
        if self.one_sided {
            let mut maximum = zero;
            for (i, thruster) in self.thrusters.iter().enumerate() {
                maximum = maximum.max((thrusts[i] * L::splat(thruster.relative)).abs());
            }
            // Rounding limits nothing.
            let noise = maximum * L::c(ROUNDING.max(4.0 * T::EPSILON));
            for (i, thruster) in self.thrusters.iter().enumerate() {
                let counts = noise.lt((thrusts[i] * L::splat(thruster.relative)).abs());
                excess = L::select(counts, thruster.ratio(thrusts[i]), one).max(excess);
            }
        } else {
            for (i, thruster) in self.thrusters.iter().enumerate() {
                excess = thruster.ratio(thrusts[i]).max(excess);
            }
        }
        excess
    }

    /// Scales the thrusts by the remaining gain of each thruster; effort counts them as commanded.
    #[inline(always)]
    pub fn scale_thrusts<L: Lane<Real = T>>(&self, actuated: &mut Actuated<L>, gains: &[L; THRUSTERS]) {
        let mut wrench = [L::zero(); 6];
        for (i, thruster) in self.thrusters.iter().enumerate() {
            actuated.thrusts[i] = actuated.thrusts[i] * gains[i];
            for k in 0..6 {
                wrench[k] = actuated.thrusts[i].mul_add(L::splat(thruster.wrench[k]), wrench[k]);
            }
        }
        actuated.wrench = Vector6::from_array(wrench);
    }

    /// Thrusts and torques of a row of actions.
    #[inline(always)]
    pub fn act_on_row(&self, action: &[f32]) -> Actuated<T> {
        let mut entries = [T::default(); ACTIONS];
        for k in 0..action.len() {
            entries[k] = T::from_f64(f64::from(action[k]));
        }
        self.act(&entries)
    }

    /// Thrusts and torques of an action with entries in [-1, 1]: as [`super::Allocation::allocate`], to rounding.
    #[inline(always)]
    pub fn act<L: Lane<Real = T>>(&self, action: &[L; ACTIONS]) -> Actuated<L> {
        let mut actuated = Actuated::none();
        self.act_into(action, &mut actuated);
        actuated
    }

    /// As [`Self::act`], into memory with [`Actuated::none`] or another action's result: filling all of it for each
    /// group of instances would cost measurable time.
    #[inline(always)]
    pub fn act_into<L: Lane<Real = T>>(&self, action: &[L; ACTIONS], actuated: &mut Actuated<L>) {
        let (zero, one) = (L::zero(), L::c(1.0));
        let Actuated { thrusts, torques, .. } = actuated;
        let count = self.thrusters.len();
        match self.kind {
            ActionKind::Wrench | ActionKind::Residual => {
                for i in 0..count {
                    let thruster = &self.thrusters[i];
                    let mut thrust = action[0] * L::splat(thruster.demand[0]);
                    for k in 1..6 {
                        thrust = action[k].mul_add(L::splat(thruster.demand[k]), thrust);
                    }
                    thrusts[i] = thrust;
                }
                // All are scaled down together where one would exceed its limit.
                let factor = one / self.excess(thrusts);
                for i in 0..count {
                    let [lower, upper] = self.thrusters[i].limits;
                    thrusts[i] = (thrusts[i] * factor).min(L::splat(upper)).max(L::splat(lower));
                }
            }
            ActionKind::Thrusters => {
                for i in 0..count {
                    let [lower, upper] = self.thrusters[i].limits;
                    let limit = L::select(zero.lt(action[i]), L::splat(upper), L::splat(lower));
                    thrusts[i] = action[i].abs() * limit;
                }
            }
        }
        let mut wrench = [zero; 6];
        let (mut square, mut power, mut saturation) = (zero, zero, zero);
        for i in 0..count {
            let (thruster, thrust) = (&self.thrusters[i], thrusts[i]);
            for k in 0..6 {
                wrench[k] = thrust.mul_add(L::splat(thruster.wrench[k]), wrench[k]);
            }
            let (size, [lower, upper]) = (thrust.abs(), thruster.full);
            let u = size * L::splat(thruster.relative);
            square = u.mul_add(u, square);
            power = u.mul_add(u.sqrt(), power);
            let full = L::select(zero.lt(thrust), L::splat(upper), L::splat(lower));
            saturation = L::select(size.lt(full), saturation, saturation + one);
        }
        let first = self.len - self.torques.len();
        for (i, maximum) in self.torques.iter().enumerate() {
            let (a, u) = (action[first + i], action[first + i].abs());
            torques[i] = a * L::splat(*maximum);
            square = u.mul_add(u, square);
            power = u.mul_add(u.sqrt(), power);
            saturation = L::select(u.lt(L::splat(self.near)), saturation, saturation + one);
        }
        let share = L::splat(self.share);
        actuated.wrench = Vector6::from_array(wrench);
        (actuated.square, actuated.power, actuated.saturation) = (square * share, power * share, saturation * share);
    }
}

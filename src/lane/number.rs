//! Traits of lanes, of their number types and of kernels.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use super::isa::Isa;

/// One number per instance of a group of `LANES` instances.
pub trait Lane:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + Send
    + 'static
{
    /// Number type of one lane.
    type Real: Real;
    /// One boolean per lane.
    type Mask: Copy;
    /// Instances per group.
    const LANES: usize;
    /// True for values with slopes, which [`Self::read`] and [`Self::write`] have in two halves of a memory.
    const SLOPES: bool = false;
    /// True where a group is one instance. (As the whole condition of an `if` it spares the compiler the branch not taken.)
    const SCALAR: bool = Self::LANES == 1;
    /// True for scalars that have steps without the terms of baseline methods, too: these take less time.
    const LEAN_STEPS: bool = Self::SCALAR;

    /// Runs a routine of a kernel as a function of its own, compiled for the instruction set of these lanes. (The compiler's
    /// time grows with more than the length of a function: where a call costs nothing noticeable, it saves most of that.)
    #[inline(always)]
    fn call<R: Routine<Self>>(routine: &mut R) {
        routine.run();
    }

    /// True for lanes of an instruction set with 32 registers; others have 16.
    const MANY_REGISTERS: bool = false;
    /// True for lanes whose machine code counts for more than their speed: one form of the articulated-body algorithm, for all
    /// kinds of systems and joints, gives the same values as the forms for some of them.
    const ONE_FORM: bool = false;

    /// The same number in every lane.
    fn splat(x: Self::Real) -> Self;
    /// Reads `LANES` numbers from the front of `from`.
    fn load(from: &[Self::Real]) -> Self;
    /// Writes `LANES` numbers to the front of `to`.
    fn store(self, to: &mut [Self::Real]);
    /// Reads `LANES` numbers of a memory from number `at` on; none beyond it.
    #[inline(always)]
    fn read(numbers: &[Self::Real], at: usize) -> Option<Self> {
        match numbers.get(at..at + Self::LANES) {
            Some(numbers) => Some(Self::load(numbers)),
            None => None,
        }
    }
    /// Writes `LANES` numbers to a memory from number `at` on; nothing beyond it.
    #[inline(always)]
    fn write(self, numbers: &mut [Self::Real], at: usize) {
        if let Some(numbers) = numbers.get_mut(at..at + Self::LANES) {
            self.store(numbers);
        }
    }
    /// Writes the nearest f32 to a memory from number `at` on: [`super::Dual`] values to its first half, slopes to its second.
    #[inline(always)]
    fn store_single_at(self, numbers: &mut [f32], at: usize) {
        self.store_single(&mut numbers[at..]);
    }
    /// The same number as a constant in differentiation: [`super::Dual`] drops its slope.
    #[inline(always)]
    fn constant(self) -> Self {
        self
    }
    /// `self * a + b`, rounded once if the machine has fused multiply-add.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Magnitude.
    fn abs(self) -> Self;
    /// Nearest integer, ties to even.
    fn round(self) -> Self;
    /// Lanes where `self < other`; false for NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// `yes` in lanes where the mask is true, else `no`.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// Logical and of masks.
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The mask as bits: bit k is lane k.
    fn bits(mask: Self::Mask) -> u32;
    /// Mantissa in [1, 2) and binary exponent of a positive normal number; unspecified for others.
    fn split(self) -> (Self, Self);
    /// `1 / sqrt(x)` of a positive normal number to within 3.5 %, from its bits; unspecified for others.
    fn inverse_sqrt_estimate(self) -> Self;
    /// Reads `LANES` f32 from the front of `from`; exact.
    fn load_single(from: &[f32]) -> Self;
    /// Writes the nearest f32 to the front of `to`.
    fn store_single(self, to: &mut [f32]);
    /// Writes f64 to the front of `to`; exact.
    fn store_double(self, to: &mut [f64]);

    /// True if the mask is true in any lane.
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        Self::bits(mask) != 0
    }

    /// A constant.
    #[inline(always)]
    fn c(x: f64) -> Self {
        Self::splat(Self::Real::from_f64(x))
    }
    /// Zero.
    #[inline(always)]
    fn zero() -> Self {
        Self::c(0.0)
    }
    /// `b - self * a`.
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        (-self).mul_add(a, b)
    }
    /// Minimum; `other` where either is NaN.
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self::select(self.lt(other), self, other)
    }
    /// Maximum; `other` where either is NaN.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self::select(other.lt(self), self, other)
    }
}

/// Part of a kernel that may be a function of its own.
pub trait Routine<L: Lane> {
    /// True if it may run outside kernels too, where the instruction set is not known.
    const PORTABLE: bool = false;

    /// Runs the routine. Implementations are `#[inline(always)]`.
    fn run(&mut self);
}

/// Computation over lanes of any width.
pub trait Kernel<T: Real> {
    /// Runs the computation. Implementations, and all functions that they call on the hot path, are `#[inline(always)]`, so that
    /// they are compiled with the instruction set of the caller.
    fn run<L: Lane<Real = T>>(&mut self);
}

/// Number type of lanes.
pub trait Real: Lane<Real = Self> + Default + PartialOrd + Send + Sync + 'static {
    /// Instances per block of memory: a multiple of every lane width.
    const BLOCK: usize;
    /// Unit round-off times two.
    const EPSILON: f64;
    /// True if shorter polynomials reach this type's accuracy.
    const SINGLE: bool;

    /// Nearest value.
    fn from_f64(x: f64) -> Self;
    /// Exact conversion.
    fn to_f64(self) -> f64;
    /// Runs a kernel on the lanes of `isa`; on scalars if `isa` is not available on this machine.
    fn dispatch<K: Kernel<Self>>(isa: Isa, kernel: &mut K);
    /// Instruction set whose lanes run a kernel for `isa`. In single precision that is AVX2 or NEON in place of scalars with
    /// fused multiply-add: the same bits. (Those scalars would be a tenth of the machine code, and save a single instance
    /// without arm a tenth of its time.)
    fn lanes(isa: Isa) -> Isa;
    /// Runs a kernel one instance at a time, on the scalars of `isa` ([`Self::lanes`]): the same bits as [`Self::dispatch`] in
    /// half the machine code, for work whose speed does not matter.
    fn dispatch_narrow<K: Kernel<Self>>(isa: Isa, kernel: &mut K);
    /// As [`Self::dispatch`], with the lanes of AVX2 or NEON in place of scalars with fused multiply-add: the same bits, for kernels
    /// whose machine code counts for more than the time of a single instance where these scalars are forced.
    fn dispatch_lanes<K: Kernel<Self>>(isa: Isa, kernel: &mut K);
    /// Runs a kernel on scalars without fused multiply-add.
    fn dispatch_plain<K: Kernel<Self>>(kernel: &mut K);
    /// Runs a kernel only on the lanes of AVX2 or NEON, for work that fills lanes with one instance; does nothing on machines
    /// without. (Kernels of dual numbers take half a minute each to compile; AVX-512 saved a sixth of the time.)
    fn dispatch_wide<K: Kernel<Self>>(kernel: &mut K);
    /// Runs a kernel on the lanes of `isa`, with fused multiply-add in all of them; does nothing on machines without.
    fn dispatch_fused<K: Kernel<Self>>(isa: Isa, kernel: &mut K);
}

/// Implements the operators of a lane by expressions in their operands, and the compound assignments by these.
macro_rules! operators {
    (@ [$lane:ty $(where $L:ident)?] $operator:ident $method:ident($a:ident $(, $b:ident)?) = $value:expr) => {
        impl$(<$L: Lane>)? std::ops::$operator for $lane {
            type Output = Self;
            #[inline(always)]
            fn $method(self $(, $b: Self)?) -> Self {
                let $a = self;
                $value
            }
        }
    };
    (@ [$lane:ty $(where $L:ident)?] $operator:ident $method:ident $sign:tt) => {
        impl$(<$L: Lane>)? std::ops::$operator for $lane {
            #[inline(always)]
            fn $method(&mut self, other: Self) {
                *self = *self $sign other;
            }
        }
    };
    ($lane:tt $($operator:ident $method:ident($($x:ident),+) = $value:expr;)+) => {
        $(operators!(@ $lane $operator $method($($x),+) = $value);)+
        operators!(@ $lane AddAssign add_assign +);
        operators!(@ $lane SubAssign sub_assign -);
    };
}
pub(crate) use operators;

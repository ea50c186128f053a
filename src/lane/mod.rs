//! Numbers: scalars, SIMD lanes and dual numbers.
//!
//! Every formula of the kernel is written once, over [`Lane`]: a scalar, a SIMD vector with one number per instance, or a dual
//! number. All operations are IEEE operations in the same order at every width, so an instance's result does not depend on its
//! lane nor, with fused multiply-add, on the width.

mod dispatch;
mod dual;
mod elementary;
#[cfg(target_arch = "aarch64")]
mod neon;
mod prefetch;
mod rows;
mod scalar;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod simd;
mod transpose;
#[cfg(target_arch = "x86_64")]
mod x86;

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

pub use dispatch::{Isa, Kernel, Real, UnknownIsa};
pub use dual::Dual;
pub use elementary::{atan2, exp, horner, inverse_sqrt, ln, ln_1p, sin_cos, sin_cos_near, tanh};
pub use prefetch::prefetch_after;
pub use rows::Rows;
pub use transpose::{Entry, transpose};

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
    /// Whether a group is one instance. (As the whole condition of an `if` it spares the compiler the branch not taken.)
    const SCALAR: bool = Self::LANES == 1;

    /// The same number in every lane.
    fn splat(x: Self::Real) -> Self;
    /// Reads `LANES` numbers from the front of `from`.
    fn load(from: &[Self::Real]) -> Self;
    /// Writes `LANES` numbers to the front of `to`.
    fn store(self, to: &mut [Self::Real]);
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

/// A parameter of the system: shared by all lanes, or one number per lane.
pub trait Param<L: Lane>: Copy {
    /// True if the parameter is the same in all lanes.
    const SHARED: bool;

    /// The parameter in lanes.
    fn get(self) -> L;
}

impl<L: Lane> Param<L> for L {
    const SHARED: bool = false;

    #[inline(always)]
    fn get(self) -> L {
        self
    }
}

/// A parameter shared by all lanes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(transparent)]
pub struct Shared<T>(pub T);

impl<L: Lane> Param<L> for Shared<L::Real> {
    const SHARED: bool = true;

    #[inline(always)]
    fn get(self) -> L {
        L::splat(self.0)
    }
}

/// Parameters in lanes. (Not `map`: a closure would not inherit the caller's instruction set.)
#[inline(always)]
pub fn get_all<L: Lane, P: Param<L>, const K: usize>(parameters: &[P; K]) -> [L; K] {
    let mut out = [L::zero(); K];
    for i in 0..K {
        out[i] = parameters[i].get();
    }
    out
}

/// An optional parameter in lanes. (Not `map`: a closure would not inherit the caller's instruction set.)
#[expect(clippy::manual_map, reason = "a closure would not inherit the caller's instruction set")]
#[inline(always)]
pub fn get_option<L: Lane, P: Param<L>>(parameter: Option<P>) -> Option<L> {
    match parameter {
        Some(parameter) => Some(parameter.get()),
        None => None,
    }
}

/// Implements the compound assignment operators by the binary ones.
macro_rules! assigning_ops {
    ($lane:ty) => {
        impl std::ops::AddAssign for $lane {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }
        impl std::ops::SubAssign for $lane {
            #[inline(always)]
            fn sub_assign(&mut self, other: Self) {
                *self = *self - other;
            }
        }
    };
}
pub(crate) use assigning_ops;

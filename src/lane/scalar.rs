//! Scalar lanes: one instance at a time.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::elementary::{INVERSE_SQRT, INVERSE_SQRT_SINGLE};
use super::isa::Isa;
use super::number::{Lane, Routine, assigning_ops};

macro_rules! scalar_lane {
    ($real:ty, $module:ident, $fraction:expr, $exponent:expr, $inverse_sqrt:expr) => {
        // In a module for each kind of lanes: the compiler works on several modules at a time.
        mod $module {
            use super::Routine;

            #[cfg_attr(target_arch = "x86_64", target_feature(enable = "fma"))]
            #[inline(never)]
            pub(super) fn call<R: Routine<$real>>(routine: &mut R) {
                routine.run();
            }
        }

        impl Lane for $real {
            type Real = $real;
            type Mask = bool;
            const LANES: usize = 1;

            #[inline(always)]
            fn call<R: Routine<Self>>(routine: &mut R) {
                if R::PORTABLE && !Isa::Fma.detected() {
                    return routine.run();
                }
                assert!(Isa::Fma.detected(), "kernels run on these lanes where there is fused multiply-add");
                // SAFETY: the feature has been detected.
                #[allow(unused_unsafe, reason = "needed on x86-64 alone")]
                unsafe {
                    $module::call(routine)
                }
            }
            #[inline(always)]
            fn splat(x: $real) -> Self {
                x
            }
            #[inline(always)]
            fn load(from: &[$real]) -> Self {
                from[0]
            }
            #[inline(always)]
            fn store(self, to: &mut [$real]) {
                to[0] = self;
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                <$real>::mul_add(self, a, b)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                <$real>::sqrt(self)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                <$real>::abs(self)
            }
            #[inline(always)]
            fn round(self) -> Self {
                <$real>::round_ties_even(self)
            }
            #[inline(always)]
            fn lt(self, other: Self) -> bool {
                self < other
            }
            #[inline(always)]
            fn select(mask: bool, yes: Self, no: Self) -> Self {
                if mask { yes } else { no }
            }
            #[inline(always)]
            fn and(a: bool, b: bool) -> bool {
                a & b
            }
            #[inline(always)]
            fn bits(mask: bool) -> u32 {
                u32::from(mask)
            }
            #[inline(always)]
            fn split(self) -> (Self, Self) {
                let bits = self.to_bits();
                let mantissa = <$real>::from_bits(bits & $fraction | (1.0 as $real).to_bits());
                let exponent = bits >> (<$real>::MANTISSA_DIGITS - 1) & $exponent;
                (mantissa, exponent as $real - ($exponent >> 1) as $real)
            }
            #[inline(always)]
            fn inverse_sqrt_estimate(self) -> Self {
                <$real>::from_bits($inverse_sqrt.wrapping_sub(self.to_bits() >> 1))
            }
            #[inline(always)]
            fn load_single(from: &[f32]) -> Self {
                from[0] as $real
            }
            #[inline(always)]
            fn store_single(self, to: &mut [f32]) {
                to[0] = self as f32;
            }
            #[inline(always)]
            fn store_double(self, to: &mut [f64]) {
                to[0] = self as f64;
            }
        }
    };
}
scalar_lane!(f64, double, (1 << 52) - 1, 0x7ff, INVERSE_SQRT);
scalar_lane!(f32, single, (1 << 23) - 1, 0xff, INVERSE_SQRT_SINGLE);

/// A scalar whose multiply-add rounds twice, for machines without fused multiply-add, where `f64::mul_add` is a slow call.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unfused<T>(pub T);

macro_rules! unfused_lane {
    ($real:ty, $module:ident) => {
        mod $module {
            use super::{Routine, Unfused};

            #[inline(never)]
            pub(super) fn call<R: Routine<Unfused<$real>>>(routine: &mut R) {
                routine.run();
            }
        }

        impl Add for Unfused<$real> {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                Self(self.0 + other.0)
            }
        }
        impl Sub for Unfused<$real> {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                Self(self.0 - other.0)
            }
        }
        impl Mul for Unfused<$real> {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                Self(self.0 * other.0)
            }
        }
        impl Div for Unfused<$real> {
            type Output = Self;
            #[inline(always)]
            fn div(self, other: Self) -> Self {
                Self(self.0 / other.0)
            }
        }
        impl Neg for Unfused<$real> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self(-self.0)
            }
        }
        assigning_ops!(Unfused<$real>);

        impl Lane for Unfused<$real> {
            type Real = $real;
            type Mask = bool;
            const LANES: usize = 1;

            #[inline(always)]
            fn call<R: Routine<Self>>(routine: &mut R) {
                $module::call(routine);
            }
            #[inline(always)]
            fn splat(x: $real) -> Self {
                Self(x)
            }
            #[inline(always)]
            fn load(from: &[$real]) -> Self {
                Self(from[0])
            }
            #[inline(always)]
            fn store(self, to: &mut [$real]) {
                to[0] = self.0;
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                self * a + b
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                Self(self.0.sqrt())
            }
            #[inline(always)]
            fn abs(self) -> Self {
                Self(self.0.abs())
            }
            // By addition: without SSE4.1, rounding would be a library call.
            #[inline(always)]
            fn round(self) -> Self {
                // All numbers of at least this magnitude are integers.
                const INTEGERS_FROM: $real = 1.0 / <$real>::EPSILON;
                let size = self.0.abs();
                let integer = if size < INTEGERS_FROM { (size + INTEGERS_FROM) - INTEGERS_FROM } else { size };
                Self(integer.copysign(self.0))
            }
            #[inline(always)]
            fn lt(self, other: Self) -> bool {
                self.0 < other.0
            }
            #[inline(always)]
            fn select(mask: bool, yes: Self, no: Self) -> Self {
                if mask { yes } else { no }
            }
            #[inline(always)]
            fn and(a: bool, b: bool) -> bool {
                a & b
            }
            #[inline(always)]
            fn bits(mask: bool) -> u32 {
                u32::from(mask)
            }
            #[inline(always)]
            fn split(self) -> (Self, Self) {
                let (mantissa, exponent) = self.0.split();
                (Self(mantissa), Self(exponent))
            }
            #[inline(always)]
            fn inverse_sqrt_estimate(self) -> Self {
                Self(self.0.inverse_sqrt_estimate())
            }
            #[inline(always)]
            fn load_single(from: &[f32]) -> Self {
                Self(from[0] as $real)
            }
            #[inline(always)]
            fn store_single(self, to: &mut [f32]) {
                to[0] = self.0 as f32;
            }
            #[inline(always)]
            fn store_double(self, to: &mut [f64]) {
                to[0] = self.0 as f64;
            }
        }
    };
}
unfused_lane!(f64, plain_double);
unfused_lane!(f32, plain_single);

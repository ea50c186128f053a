//! Scalar lanes: one instance at a time.

use std::convert::identity;

use super::elementary::{INVERSE_SQRT, INVERSE_SQRT_SINGLE};
use super::isa::Isa;
use super::number::{Lane, Routine, operators};

/// Methods of lanes that consist of `$number`, and are made of it by `$make`.
macro_rules! one_number {
    ($real:ty, $make:expr, $self:ident => $number:expr) => {
        type Real = $real;
        type Mask = bool;
        const LANES: usize = 1;

        #[inline(always)]
        fn splat(x: $real) -> Self {
            $make(x)
        }
        #[inline(always)]
        fn load(from: &[$real]) -> Self {
            $make(from[0])
        }
        #[inline(always)]
        fn store($self, to: &mut [$real]) {
            to[0] = $number;
        }
        #[inline(always)]
        fn sqrt($self) -> Self {
            $make(<$real>::sqrt($number))
        }
        #[inline(always)]
        fn abs($self) -> Self {
            $make(<$real>::abs($number))
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
        fn load_single(from: &[f32]) -> Self {
            $make(from[0] as $real)
        }
        #[inline(always)]
        fn store_single($self, to: &mut [f32]) {
            to[0] = $number as f32;
        }
        #[inline(always)]
        fn store_double($self, to: &mut [f64]) {
            to[0] = $number as f64;
        }
    };
}

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
            one_number!($real, identity, self => self);

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
            fn mul_add(self, a: Self, b: Self) -> Self {
                <$real>::mul_add(self, a, b)
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

        operators! { [Unfused<$real>]
            Add add(a, b) = Self(a.0 + b.0);
            Sub sub(a, b) = Self(a.0 - b.0);
            Mul mul(a, b) = Self(a.0 * b.0);
            Div div(a, b) = Self(a.0 / b.0);
            Neg neg(a) = Self(-a.0);
        }

        impl Lane for Unfused<$real> {
            one_number!($real, Self, self => self.0);
            // Machines without fused multiply-add are old and rare: half the machine code counts for more.
            const LEAN_STEPS: bool = false;
            const ONE_FORM: bool = true;

            #[inline(always)]
            fn call<R: Routine<Self>>(routine: &mut R) {
                $module::call(routine);
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                self * a + b
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
            fn split(self) -> (Self, Self) {
                let (mantissa, exponent) = self.0.split();
                (Self(mantissa), Self(exponent))
            }
            #[inline(always)]
            fn inverse_sqrt_estimate(self) -> Self {
                Self(self.0.inverse_sqrt_estimate())
            }
        }
    };
}
unfused_lane!(f64, plain_double);
unfused_lane!(f32, plain_single);

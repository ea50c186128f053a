//! Common code of SIMD lanes.
//!
//! The intrinsics need CPU features that the surrounding functions do not declare. Every function here is inlined into a
//! monomorph that declares them ([`super::dispatch`]), and the types are reachable through that dispatch only.

/// Defines a lane by a vector type and its intrinsics.
macro_rules! simd_lane {
    (
        $(#[$doc:meta])* $name:ident, $module:ident, $features:literal, $real:ty, $vector:ty, $mask:ty, $lanes:literal,
        $set1:ident, $load:ident, $store:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $fma:expr,
        $sqrt:ident, $min:expr, $max:expr, $abs:expr, $round:expr, $lt:expr, $select:expr, $and:expr, $bits:expr, $split:expr, $estimate:expr,
        $load_single:expr, $store_single:expr, $store_double:expr
    ) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy)]
        #[repr(transparent)]
        pub struct $name($vector);

        // The CPU has the feature named in the type's documentation: `dispatch` hands these types out only after it has
        // detected that feature, and the intrinsics are sound there. Loads and stores go through slices of all lanes.
        impl Add for $name {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                // SAFETY: the CPU has the feature.
                Self(unsafe { $add(self.0, other.0) })
            }
        }
        impl Sub for $name {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                // SAFETY: the CPU has the feature.
                Self(unsafe { $sub(self.0, other.0) })
            }
        }
        impl Mul for $name {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                // SAFETY: the CPU has the feature.
                Self(unsafe { $mul(self.0, other.0) })
            }
        }
        impl Div for $name {
            type Output = Self;
            #[inline(always)]
            fn div(self, other: Self) -> Self {
                // SAFETY: the CPU has the feature.
                Self(unsafe { $div(self.0, other.0) })
            }
        }
        impl Neg for $name {
            type Output = Self;
            // -0 - x is the exact negation, and the form that the compiler folds into a multiply-add.
            #[inline(always)]
            fn neg(self) -> Self {
                // SAFETY: the CPU has the feature.
                Self(unsafe { $sub($set1(-0.0), self.0) })
            }
        }
        assigning_ops!($name);

        // In a module for each kind of lanes: the compiler works on several modules at a time.
        mod $module {
            use super::{$name, Routine};

            #[target_feature(enable = $features)]
            #[inline(never)]
            pub(super) fn call<R: Routine<$name>>(routine: &mut R) {
                routine.run();
            }
        }

        impl Lane for $name {
            type Real = $real;
            type Mask = $mask;
            const LANES: usize = $lanes;

            #[inline(always)]
            fn call<R: Routine<Self>>(routine: &mut R) {
                // SAFETY: the CPU has the feature.
                unsafe { $module::call(routine) }
            }
            #[inline(always)]
            fn splat(x: $real) -> Self {
                // SAFETY: the CPU has the feature.
                Self(unsafe { $set1(x) })
            }
            #[inline(always)]
            fn load(from: &[$real]) -> Self {
                let from = &from[..$lanes];
                // SAFETY: the CPU has the feature, and the slice has all lanes.
                Self(unsafe { $load(from.as_ptr()) })
            }
            #[inline(always)]
            fn store(self, to: &mut [$real]) {
                let to = &mut to[..$lanes];
                // SAFETY: the CPU has the feature, and the slice has all lanes.
                unsafe { $store(to.as_mut_ptr(), self.0) }
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                // SAFETY: the CPU has the feature.
                Self(unsafe { $fma(self.0, a.0, b.0) })
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                // SAFETY: the CPU has the feature.
                Self(unsafe { $sqrt(self.0) })
            }
            // Both return the second operand where either is NaN.
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                // SAFETY: the CPU has the feature.
                Self(unsafe { $min(self.0, other.0) })
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                // SAFETY: the CPU has the feature.
                Self(unsafe { $max(self.0, other.0) })
            }
            #[inline(always)]
            fn abs(self) -> Self {
                // SAFETY: the CPU has the feature.
                Self(unsafe { $abs(self.0) })
            }
            #[inline(always)]
            fn round(self) -> Self {
                // SAFETY: the CPU has the feature.
                Self(unsafe { $round(self.0) })
            }
            #[inline(always)]
            fn lt(self, other: Self) -> $mask {
                // SAFETY: the CPU has the feature.
                unsafe { $lt(self.0, other.0) }
            }
            #[inline(always)]
            fn select(mask: $mask, yes: Self, no: Self) -> Self {
                // SAFETY: the CPU has the feature.
                Self(unsafe { $select(mask, yes.0, no.0) })
            }
            #[inline(always)]
            fn and(a: $mask, b: $mask) -> $mask {
                // SAFETY: the CPU has the feature.
                unsafe { $and(a, b) }
            }
            #[inline(always)]
            fn bits(mask: $mask) -> u32 {
                // SAFETY: the CPU has the feature.
                unsafe { $bits(mask) }
            }
            #[inline(always)]
            fn split(self) -> (Self, Self) {
                // SAFETY: the CPU has the feature.
                let (mantissa, exponent) = unsafe { $split(self.0) };
                (Self(mantissa), Self(exponent))
            }
            #[inline(always)]
            fn inverse_sqrt_estimate(self) -> Self {
                // SAFETY: the CPU has the feature.
                Self(unsafe { $estimate(self.0) })
            }
            #[inline(always)]
            fn load_single(from: &[f32]) -> Self {
                let from = &from[..$lanes];
                // SAFETY: the CPU has the feature, and the slice has all lanes.
                Self(unsafe { $load_single(from.as_ptr()) })
            }
            #[inline(always)]
            fn store_single(self, to: &mut [f32]) {
                let to = &mut to[..$lanes];
                // SAFETY: the CPU has the feature, and the slice has all lanes.
                unsafe { $store_single(to.as_mut_ptr(), self.0) }
            }
            #[inline(always)]
            fn store_double(self, to: &mut [f64]) {
                let to = &mut to[..$lanes];
                // SAFETY: the CPU has the feature, and the slice has all lanes.
                unsafe { $store_double(to.as_mut_ptr(), self.0) }
            }
        }
    };
}
pub(super) use simd_lane;

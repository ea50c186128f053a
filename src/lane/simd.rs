//! Common code of SIMD lanes.
//!
//! The intrinsics need CPU features that the surrounding functions do not declare. Every function here is inlined into a
//! monomorph that declares them ([`super::dispatch`]), and the types are reachable through that dispatch only.

/// A call of an intrinsic by a lane.
macro_rules! intrinsic {
    ($call:expr) => {
        // SAFETY: the CPU has the feature named in the type's documentation: `dispatch` hands these types out only after it has
        // detected that feature. Loads and stores go through slices of all lanes.
        unsafe { $call }
    };
}
pub(super) use intrinsic;

/// Methods of a lane, inlined.
macro_rules! methods {
    ($($name:ident($($argument:tt)*) -> $to:ty = $value:expr;)+) => {
        $(#[inline(always)]
        fn $name($($argument)*) -> $to {
            $value
        })+
    };
}
pub(super) use methods;

/// Short functions on vectors. (Closures would not be inlined: they have no instruction set of their own.)
macro_rules! inlined {
    ($($name:ident($($x:ident: $from:ty),+) -> $to:ty = $value:expr;)+) => {
        $(#[inline(always)]
        unsafe fn $name($($x: $from),+) -> $to {
            // SAFETY: by the contract of the function; its callers are the expansions of `simd_lane`.
            #[allow(unused_unsafe, reason = "operations on masks are safe, and intrinsics of NEON")]
            unsafe { $value }
        })+
    };
}
pub(super) use inlined;

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

        operators! { [$name]
            Add add(a, b) = Self(intrinsic!($add(a.0, b.0)));
            Sub sub(a, b) = Self(intrinsic!($sub(a.0, b.0)));
            Mul mul(a, b) = Self(intrinsic!($mul(a.0, b.0)));
            Div div(a, b) = Self(intrinsic!($div(a.0, b.0)));
            // -0 - x is the exact negation, and the form that the compiler folds into a multiply-add.
            Neg neg(a) = Self(intrinsic!($sub($set1(-0.0), a.0)));
        }

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
            const MANY_REGISTERS: bool = cfg!(target_arch = "aarch64") || size_of::<$vector>() == 64;

            #[inline(always)]
            fn call<R: Routine<Self>>(routine: &mut R) {
                intrinsic!($module::call(routine))
            }
            methods! {
                splat(x: $real) -> Self = Self(intrinsic!($set1(x)));
                load(from: &[$real]) -> Self = Self(intrinsic!($load(from[..$lanes].as_ptr())));
                store(self, to: &mut [$real]) -> () = intrinsic!($store(to[..$lanes].as_mut_ptr(), self.0));
                mul_add(self, a: Self, b: Self) -> Self = Self(intrinsic!($fma(self.0, a.0, b.0)));
                sqrt(self) -> Self = Self(intrinsic!($sqrt(self.0)));
                // Both return the second operand where either is NaN.
                min(self, other: Self) -> Self = Self(intrinsic!($min(self.0, other.0)));
                max(self, other: Self) -> Self = Self(intrinsic!($max(self.0, other.0)));
                abs(self) -> Self = Self(intrinsic!($abs(self.0)));
                round(self) -> Self = Self(intrinsic!($round(self.0)));
                lt(self, other: Self) -> $mask = intrinsic!($lt(self.0, other.0));
                select(mask: $mask, yes: Self, no: Self) -> Self = Self(intrinsic!($select(mask, yes.0, no.0)));
                and(a: $mask, b: $mask) -> $mask = intrinsic!($and(a, b));
                bits(mask: $mask) -> u32 = intrinsic!($bits(mask));
                split(self) -> (Self, Self) = {
                    let (mantissa, exponent) = intrinsic!($split(self.0));
                    (Self(mantissa), Self(exponent))
                };
                inverse_sqrt_estimate(self) -> Self = Self(intrinsic!($estimate(self.0)));
                load_single(from: &[f32]) -> Self = Self(intrinsic!($load_single(from[..$lanes].as_ptr())));
                store_single(self, to: &mut [f32]) -> () =
                    intrinsic!($store_single(to[..$lanes].as_mut_ptr(), self.0));
                store_double(self, to: &mut [f64]) -> () =
                    intrinsic!($store_double(to[..$lanes].as_mut_ptr(), self.0));
            }
        }
    };
}
pub(super) use simd_lane;

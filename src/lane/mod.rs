//! Numbers: scalars, SIMD lanes and dual numbers.
//!
//! Every formula of the kernel is written once, over [`Lane`]: a scalar, a SIMD vector with one number per instance, or a dual
//! number. All operations are IEEE operations in the same order at every width, so an instance's result does not depend on its
//! lane nor, with fused multiply-add, on the width.
//!
//! Functions of kernels are `#[inline(always)]`: a generic function or a closure that stays a call is compiled without the
//! caller's instruction set (rust-lang/rust#58279).

/// A loop written out, as `unroll!(k in 0 1 2 => { ... })` or, below the constant `N`, `unroll!(k < N => { ... })` (15 times).
///
/// A kernel is one function with everything inlined: as loops its thousands of short ones would take most of the compiler's
/// time.
macro_rules! unroll {
    ($k:ident in $($i:literal)* => $body:block) => {
        $({
            let $k: usize = $i;
            $body
        })*
    };
    ($k:ident < $n:expr => $body:block) => {
        unroll!(@ $k, $n, $body, 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14);
        if const { 15 < $n } {
            for $k in 15..$n $body
        }
    };
    (@ $k:ident, $n:expr, $body:block, $($i:literal)*) => {
        $(
            if const { $i < $n } {
                let $k: usize = $i;
                $body
            }
        )*
    };
}
pub(crate) use unroll;

#[allow(unsafe_code)]
mod dispatch;
mod dual;
mod elementary;
mod function;
mod isa;
#[cfg(target_arch = "aarch64")]
#[allow(unsafe_code)]
mod neon;
mod number;
mod numbers;
#[allow(unsafe_code)]
mod param;
#[allow(unsafe_code)]
mod prefetch;
#[allow(unsafe_code)]
mod rows;
#[allow(unsafe_code)]
mod scalar;
mod separate;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
#[allow(unsafe_code)]
mod simd;
mod tape;
#[allow(unsafe_code)]
mod transpose;
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod x86;

pub use dual::Dual;
pub use elementary::{
    atan2, exp, first, horner, inverse_sqrt, is_far, ln, ln_1p, sin_cos, sin_cos_beyond, sin_cos_near, tanh,
};
pub use function::{Function, differentiate, evaluate};
pub use isa::{Isa, UnknownIsa};
pub use number::{Kernel, Lane, Real, Routine};
pub use numbers::{Many, Numbers, One, RunVisitor, Struct};
pub(crate) use numbers::{no_numbers, numbers};
pub use param::{Param, Shared, get_all, get_option};
pub use prefetch::prefetch_after;
pub use rows::Rows;
pub use scalar::Unfused;
pub use separate::separate;
pub use tape::Tape;
pub use transpose::{Transposable, transpose};

//! Numbers: scalars, SIMD lanes and dual numbers.
//!
//! Every formula of the kernel is written once, over [`Lane`]: a scalar, a SIMD vector with one number per instance, or a dual
//! number. All operations are IEEE operations in the same order at every width, so an instance's result does not depend on its
//! lane nor, with fused multiply-add, on the width.

mod dispatch;
mod dual;
mod elementary;
mod isa;
#[cfg(target_arch = "aarch64")]
mod neon;
mod number;
mod param;
mod prefetch;
mod rows;
mod scalar;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod simd;
mod transpose;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use dual::Dual;
pub use elementary::{atan2, exp, horner, inverse_sqrt, ln, ln_1p, sin_cos, sin_cos_near, tanh};
pub use isa::{Isa, UnknownIsa};
pub use number::{Kernel, Lane, Real};
pub use param::{Param, Shared, get_all, get_option};
pub use prefetch::prefetch_after;
pub use rows::Rows;
pub use transpose::{Entry, transpose};

//! Dispatch of kernels to the widest lanes of this machine, once per call.

use super::isa::Isa;
#[cfg(target_arch = "aarch64")]
use super::neon::{F32x4, F64x2};
use super::number::{Kernel, Real};
use super::scalar::Unfused;
#[cfg(target_arch = "x86_64")]
use super::x86::{F32x8, F32x16, F64x4, F64x8};

/// Instruction set of the lanes that take the place of scalars.
pub(super) const WIDE: Isa = if cfg!(target_arch = "aarch64") { Isa::Neon } else { Isa::Avx2 };

/// (In separate modules, so that the compiler works on both precisions in parallel.)
macro_rules! real {
    ($real:ty, $block:literal, $single:literal, $wide:ident, $half:ident, $neon:ident) => {
        #[cfg_attr(not(target_arch = "x86_64"), allow(unused_unsafe, reason = "multiply-add is in the base set there"))]
        impl Real for $real {
            const BLOCK: usize = $block;
            const EPSILON: f64 = <$real>::EPSILON as f64;
            const SINGLE: bool = $single;

            #[inline(always)]
            fn from_f64(x: f64) -> Self {
                x as $real
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                self as f64
            }

            fn dispatch<K: Kernel<Self>>(isa: Isa, kernel: &mut K) {
                match Self::lanes(isa) {
                    Isa::Plain => plain::run(kernel),
                    isa if Isa::Fma.detected() => Self::dispatch_fused(isa, kernel),
                    _ => plain::run(kernel),
                }
            }

            fn dispatch_narrow<K: Kernel<Self>>(isa: Isa, kernel: &mut K) {
                match isa {
                    Isa::Plain => plain::run(kernel),
                    _ if $single && Self::lanes(Isa::Fma).is_wide() => Self::dispatch_wide(kernel),
                    // SAFETY: the feature has been detected.
                    _ if !$single && Isa::Fma.detected() => unsafe { fma::run(kernel) },
                    _ => plain::run(kernel),
                }
            }

            fn dispatch_lanes<K: Kernel<Self>>(isa: Isa, kernel: &mut K) {
                match isa {
                    // SAFETY: the features have been detected.
                    #[cfg(target_arch = "x86_64")]
                    Isa::Avx512 if isa.detected() => unsafe { avx512::run(kernel) },
                    isa if isa != Isa::Plain && WIDE.detected() => Self::dispatch_wide(kernel),
                    _ => plain::run(kernel),
                }
            }

            fn dispatch_plain<K: Kernel<Self>>(kernel: &mut K) {
                plain::run(kernel);
            }

            fn lanes(isa: Isa) -> Isa {
                match isa {
                    Isa::Fma if $single && WIDE.detected() => WIDE,
                    Isa::Fma if $single => Isa::Plain,
                    isa => isa,
                }
            }

            fn dispatch_wide<K: Kernel<Self>>(kernel: &mut K) {
                #[cfg(target_arch = "aarch64")]
                neon::run(kernel);
                #[cfg(target_arch = "x86_64")]
                if Isa::Avx2.detected() {
                    // SAFETY: its features have been detected.
                    unsafe { avx2::run(kernel) }
                }
                let _ = kernel;
            }

            fn dispatch_fused<K: Kernel<Self>>(isa: Isa, kernel: &mut K) {
                match Self::lanes(isa) {
                    // SAFETY: the features have been detected.
                    #[cfg(target_arch = "x86_64")]
                    Isa::Avx512 if isa.detected() => unsafe { avx512::run(kernel) },
                    // SAFETY: the features have been detected.
                    #[cfg(target_arch = "x86_64")]
                    Isa::Avx2 if isa.detected() => unsafe { avx2::run(kernel) },
                    #[cfg(target_arch = "aarch64")]
                    Isa::Neon => neon::run(kernel),
                    // SAFETY: the feature has been detected.
                    _ if !$single && Isa::Fma.detected() => unsafe { fma::run(kernel) },
                    _ => {}
                }
            }
        }

        // In separate modules, whose names identify their machine code: the compiler works on several at a time.
        #[cfg(target_arch = "x86_64")]
        mod avx512 {
            #[target_feature(enable = "avx512f,avx2,fma")]
            pub(super) fn run<K: super::Kernel<$real>>(kernel: &mut K) {
                kernel.run::<super::$wide>();
            }
        }
        #[cfg(target_arch = "x86_64")]
        mod avx2 {
            #[target_feature(enable = "avx2,fma")]
            pub(super) fn run<K: super::Kernel<$real>>(kernel: &mut K) {
                kernel.run::<super::$half>();
            }
        }
        #[cfg(target_arch = "aarch64")]
        mod neon {
            #[inline(never)]
            pub(super) fn run<K: super::Kernel<$real>>(kernel: &mut K) {
                kernel.run::<super::$neon>();
            }
        }
        mod fma {
            #[cfg_attr(target_arch = "x86_64", target_feature(enable = "fma"))]
            #[cfg_attr(not(target_arch = "x86_64"), inline(never))]
            pub(super) fn run<K: super::Kernel<$real>>(kernel: &mut K) {
                kernel.run::<$real>();
            }
        }
        mod plain {
            #[inline(never)]
            pub(super) fn run<K: super::Kernel<$real>>(kernel: &mut K) {
                kernel.run::<super::Unfused<$real>>();
            }
        }
    };
}
mod double {
    use super::*;
    real!(f64, 8, false, F64x8, F64x4, F64x2);
}
mod single {
    use super::*;
    real!(f32, 16, true, F32x16, F32x8, F32x4);
}

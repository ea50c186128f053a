//! Dispatch of kernels to the widest lanes of this machine, once per call.

use std::fmt::Debug;
use std::sync::OnceLock;

use super::Lane;
#[cfg(target_arch = "aarch64")]
use super::neon::{F32x4, F64x2};
use super::scalar::Unfused;
#[cfg(target_arch = "x86_64")]
use super::x86::{F32x8, F32x16, F64x4, F64x8};

/// Environment variable that forces an instruction set: `avx512`, `avx2`, `neon`, `fma` or `plain`.
const FORCE: &str = "UVMS_INSTRUCTION_SET";

/// Instruction sets that the kernel is compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Isa {
    /// Eight f64 or sixteen f32 (x86-64 with AVX-512F).
    Avx512,
    /// Four f64 or eight f32 (x86-64 with AVX2 and FMA).
    Avx2,
    /// Two f64 or four f32 (aarch64).
    Neon,
    /// One number with fused multiply-add.
    Fma,
    /// One number, multiply and add rounded separately. Differs from the others in the last digits.
    Plain,
}

/// A forced instruction set that is unknown or not available on this machine.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{FORCE}={0:?}: this machine offers {offers}", offers = Isa::available().map(Isa::name).collect::<Vec<_>>().join(", "))]
pub struct UnknownIsa(pub String);

impl Isa {
    /// Instruction sets of this machine, widest first.
    pub fn available() -> impl Iterator<Item = Isa> {
        [Isa::Avx512, Isa::Avx2, Isa::Neon, Isa::Fma, Isa::Plain].into_iter().filter(|isa| isa.detected())
    }

    /// The widest instruction set, or the one named by the environment variable `UVMS_INSTRUCTION_SET`.
    pub fn best() -> Result<Isa, UnknownIsa> {
        Ok(Isa::chosen()?.0)
    }

    /// The fastest instruction set for a number of instances: scalar for a single one, with the same result.
    pub fn best_for(instances: usize) -> Result<Isa, UnknownIsa> {
        let (best, forced) = Isa::chosen()?;
        Ok(if instances == 1 && !forced && Isa::Fma.detected() { Isa::Fma } else { best })
    }

    /// The best instruction set, and true if it is forced.
    fn chosen() -> Result<(Isa, bool), UnknownIsa> {
        static CHOSEN: OnceLock<Result<(Isa, bool), UnknownIsa>> = OnceLock::new();
        CHOSEN
            .get_or_init(|| match std::env::var(FORCE) {
                Ok(name) => match Isa::available().find(|isa| isa.name() == name) {
                    Some(isa) => Ok((isa, true)),
                    None => Err(UnknownIsa(name)),
                },
                Err(_) => Ok((Isa::available().next().unwrap_or(Isa::Plain), false)),
            })
            .clone()
    }

    /// True if its lanes hold more than one number.
    pub fn is_wide(self) -> bool {
        !matches!(self, Isa::Fma | Isa::Plain)
    }

    /// Name as in `UVMS_INSTRUCTION_SET`.
    pub fn name(self) -> &'static str {
        match self {
            Isa::Avx512 => "avx512",
            Isa::Avx2 => "avx2",
            Isa::Neon => "neon",
            Isa::Fma => "fma",
            Isa::Plain => "plain",
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn detected(self) -> bool {
        let fma = is_x86_feature_detected!("fma");
        match self {
            Isa::Avx512 => fma && is_x86_feature_detected!("avx512f"),
            Isa::Avx2 => fma && is_x86_feature_detected!("avx2"),
            Isa::Neon => false,
            Isa::Fma => fma,
            Isa::Plain => true,
        }
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn detected(self) -> bool {
        // Apart from x86-64, multiply-add is part of the base instruction set, and so is NEON on aarch64.
        match self {
            Isa::Avx512 | Isa::Avx2 => false,
            Isa::Neon => cfg!(target_arch = "aarch64"),
            Isa::Fma | Isa::Plain => true,
        }
    }
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
    /// Runs a kernel on the lanes of `isa`; on the narrowest if `isa` is not available on this machine.
    fn dispatch<K: Kernel<Self>>(isa: Isa, kernel: &mut K);
    /// Runs a kernel one instance at a time, on the scalars of `isa`: the same bits as [`Self::dispatch`] in half the
    /// machine code, for work whose speed does not matter.
    fn dispatch_narrow<K: Kernel<Self>>(isa: Isa, kernel: &mut K);
}

/// (In separate modules, so that the compiler works on both precisions in parallel.)
macro_rules! real {
    ($real:ty, $block:literal, $single:literal, $wide:ident, $half:ident, $neon:ident) => {
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

            #[cfg(target_arch = "x86_64")]
            fn dispatch<K: Kernel<Self>>(isa: Isa, kernel: &mut K) {
                // SAFETY: each branch is taken only where its features have been detected.
                match isa {
                    Isa::Avx512 if isa.detected() => unsafe { avx512(kernel) },
                    Isa::Avx2 if isa.detected() => unsafe { avx2(kernel) },
                    Isa::Fma if isa.detected() => unsafe { fma(kernel) },
                    _ => plain(kernel),
                }
            }

            #[cfg(target_arch = "x86_64")]
            fn dispatch_narrow<K: Kernel<Self>>(isa: Isa, kernel: &mut K) {
                // SAFETY: its features have been detected.
                match isa {
                    Isa::Plain => plain(kernel),
                    _ if Isa::Fma.detected() => unsafe { fma(kernel) },
                    _ => plain(kernel),
                }
            }

            #[cfg(not(target_arch = "x86_64"))]
            fn dispatch<K: Kernel<Self>>(isa: Isa, kernel: &mut K) {
                match isa {
                    #[cfg(target_arch = "aarch64")]
                    Isa::Neon => neon(kernel),
                    _ => Self::dispatch_narrow(isa, kernel),
                }
            }

            #[cfg(not(target_arch = "x86_64"))]
            fn dispatch_narrow<K: Kernel<Self>>(isa: Isa, kernel: &mut K) {
                match isa {
                    Isa::Plain => plain(kernel),
                    _ => fma(kernel),
                }
            }
        }

        // In separate functions, whose names identify their machine code.
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx512f,avx2,fma")]
        fn avx512<K: Kernel<$real>>(kernel: &mut K) {
            kernel.run::<$wide>();
        }
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2,fma")]
        fn avx2<K: Kernel<$real>>(kernel: &mut K) {
            kernel.run::<$half>();
        }
        #[cfg(target_arch = "aarch64")]
        #[inline(never)]
        fn neon<K: Kernel<$real>>(kernel: &mut K) {
            kernel.run::<$neon>();
        }
        #[cfg_attr(target_arch = "x86_64", target_feature(enable = "fma"))]
        #[cfg_attr(not(target_arch = "x86_64"), inline(never))]
        fn fma<K: Kernel<$real>>(kernel: &mut K) {
            kernel.run::<$real>();
        }
        #[inline(never)]
        fn plain<K: Kernel<$real>>(kernel: &mut K) {
            kernel.run::<Unfused<$real>>();
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

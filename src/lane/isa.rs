//! Instruction sets.

use std::fmt::Debug;
use std::sync::OnceLock;

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

    /// The widest instruction set, or the instruction set in the environment variable `UVMS_INSTRUCTION_SET`.
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
            // Empty counts as unset, as a shell script sets it.
            .get_or_init(|| match std::env::var(FORCE) {
                Ok(name) if !name.is_empty() => match Isa::available().find(|isa| isa.name() == name) {
                    Some(isa) => Ok((isa, true)),
                    None => Err(UnknownIsa(name)),
                },
                _ => Ok((Isa::available().next().unwrap_or(Isa::Plain), false)),
            })
            .clone()
    }

    /// True if a lane has more than one number.
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

    // Inlined, since it is asked before every step of a single instance.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub(super) fn detected(self) -> bool {
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
    #[inline(always)]
    pub(super) fn detected(self) -> bool {
        // Apart from x86-64, multiply-add is part of the base instruction set, and so is NEON on aarch64.
        match self {
            Isa::Avx512 | Isa::Avx2 => false,
            Isa::Neon => cfg!(target_arch = "aarch64"),
            Isa::Fma | Isa::Plain => true,
        }
    }
}

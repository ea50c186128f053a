//! Prefetching of memory.

use super::number::Lane;

/// Size of a cache line, bytes.
#[cfg(target_arch = "x86_64")]
const LINE: usize = 64;

/// Prefetches the memory `stride` numbers after `numbers`, of the same length: the next block. A hint without effect on
/// results, valid for any address. Scalar lanes, which step single instances, prefetch nothing: there is no next block, or
/// time enough.
#[inline(always)]
pub fn prefetch_after<L: Lane, T>(numbers: &[T], stride: usize) {
    #[cfg(target_arch = "x86_64")]
    if L::LANES > 1 {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let next = numbers.as_ptr().wrapping_add(stride).cast::<i8>();
        for line in (0..size_of_val(numbers)).step_by(LINE) {
            // SAFETY: all of x86-64 has this instruction, and it does not access the address in any way that can fail.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(next.wrapping_add(line)) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (numbers, stride);
}

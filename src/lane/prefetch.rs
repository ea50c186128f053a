//! Asking for memory ahead of its use.

use super::Lane;

/// Bytes that memory comes in.
#[cfg(target_arch = "x86_64")]
const LINE: usize = 64;

/// Asks for as much as `numbers` are, `stride` numbers after them in memory: blocks are visited one after the other. A hint
/// that changes nothing, whatever is there. One number at a time, as an instance alone is stepped, there is no block after
/// this one, or time enough.
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

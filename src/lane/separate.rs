//! Order of the parts of a long calculation.

use std::sync::atomic::{Ordering, compiler_fence};

/// Ends a part of a calculation whose numbers are in memory: they are written before this and read anew after it. (Otherwise
/// the compiler begins all parts at once, and most of their numbers go through the stack, for want of registers.) It takes no
/// time.
#[inline(always)]
pub fn separate() {
    compiler_fence(Ordering::SeqCst);
}

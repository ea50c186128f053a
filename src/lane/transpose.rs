//! Transposition between tables by instance and tables by quantity.

/// Transposes a table with row stride `from_width` into one with row stride `to_width`:
/// `to[c * to_width + r] = from[r * from_width + c]` for all rows and columns of `from`.
///
/// # Panics
/// If one of the slices is too short.
#[inline(always)]
pub fn transpose<T: Transposable>(
    from: &[T],
    from_width: usize,
    to: &mut [T],
    to_width: usize,
    [rows, columns]: [usize; 2],
) {
    let edge = T::TILE;
    if rows < edge || columns < edge {
        for r in 0..rows {
            for c in 0..columns {
                to[c * to_width + r] = from[r * from_width + c];
            }
        }
        return;
    }
    let from = &from[..(rows - 1) * from_width + columns];
    let to = &mut to[..(columns - 1) * to_width + rows];
    // The last squares overlap those before them: a loop over the remainder would take longer than all squares.
    for r in (0..rows).step_by(edge) {
        let r = r.min(rows - edge);
        for c in (0..columns).step_by(edge) {
            let c = c.min(columns - edge);
            // SAFETY: r + edge <= rows and c + edge <= columns, so that the square lies in the slices just cut.
            unsafe {
                T::tile(
                    from.as_ptr().add(r * from_width + c),
                    from_width,
                    to.as_mut_ptr().add(c * to_width + r),
                    to_width,
                );
            }
        }
    }
}

/// Number types with a transposition by squares.
pub trait Transposable: Copy {
    /// Edge length of the squares.
    const TILE: usize;

    /// Transposes a square, with row strides `from_width` and `to_width`; entry by entry unless the machine has shuffles.
    ///
    /// # Safety
    /// All rows of both squares must be valid memory.
    #[inline(always)]
    unsafe fn tile(from: *const Self, from_width: usize, to: *mut Self, to_width: usize) {
        for r in 0..Self::TILE {
            for c in 0..Self::TILE {
                // SAFETY: by the contract of the function.
                unsafe { *to.add(c * to_width + r) = *from.add(r * from_width + c) };
            }
        }
    }
}

impl Transposable for f32 {
    const TILE: usize = 4;

    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    unsafe fn tile(from: *const f32, from_width: usize, to: *mut f32, to_width: usize) {
        use std::arch::x86_64::*;

        // SAFETY: by the contract of the function; every x86-64 has these instructions.
        unsafe {
            let row = |k: usize| _mm_loadu_ps(from.add(k * from_width));
            let (mut a, mut b, mut c, mut d) = (row(0), row(1), row(2), row(3));
            _MM_TRANSPOSE4_PS(&mut a, &mut b, &mut c, &mut d);
            _mm_storeu_ps(to, a);
            _mm_storeu_ps(to.add(to_width), b);
            _mm_storeu_ps(to.add(2 * to_width), c);
            _mm_storeu_ps(to.add(3 * to_width), d);
        }
    }
}

impl Transposable for f64 {
    const TILE: usize = 2;

    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    unsafe fn tile(from: *const f64, from_width: usize, to: *mut f64, to_width: usize) {
        use std::arch::x86_64::*;

        // SAFETY: by the contract of the function; every x86-64 has these instructions.
        unsafe {
            let (a, b) = (_mm_loadu_pd(from), _mm_loadu_pd(from.add(from_width)));
            _mm_storeu_pd(to, _mm_unpacklo_pd(a, b));
            _mm_storeu_pd(to.add(to_width), _mm_unpackhi_pd(a, b));
        }
    }
}

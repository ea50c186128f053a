//! From numbers by instance to numbers by lane, and back.

/// The transpose of a table in which rows are `from_width` apart, into one in which they are `to_width` apart:
/// `to[c * to_width + r] = from[r * from_width + c]` for so many rows and columns of `from`.
///
/// # Panics
/// If one of the slices is too short.
#[inline(always)]
pub fn transpose<T: Entry>(from: &[T], from_width: usize, to: &mut [T], to_width: usize, [rows, columns]: [usize; 2]) {
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
    // The last squares overlap those before them: a loop over what is left would take longer than all squares.
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

/// Numbers whose tables are transposed in squares.
pub trait Entry: Copy {
    /// Edge of the squares.
    const TILE: usize;

    /// Transposes a square in which rows are `from_width` and `to_width` apart: entry by entry where there is no better way.
    ///
    /// # Safety
    /// All rows of both squares must be there.
    #[inline(always)]
    unsafe fn tile(from: *const Self, from_width: usize, to: *mut Self, to_width: usize) {
        for r in 0..Self::TILE {
            for c in 0..Self::TILE {
                // SAFETY: as the caller says.
                unsafe { *to.add(c * to_width + r) = *from.add(r * from_width + c) };
            }
        }
    }
}

impl Entry for f32 {
    const TILE: usize = 4;

    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    unsafe fn tile(from: *const f32, from_width: usize, to: *mut f32, to_width: usize) {
        use std::arch::x86_64::*;

        // SAFETY: as the caller says; every x86-64 has these instructions.
        unsafe {
            let row = |k: usize| _mm_loadu_ps(from.add(k * from_width));
            let (mut a, mut b, mut c, mut d) = (row(0), row(1), row(2), row(3));
            _MM_TRANSPOSE4_PS(&mut a, &mut b, &mut c, &mut d);
            for (k, x) in [a, b, c, d].into_iter().enumerate() {
                _mm_storeu_ps(to.add(k * to_width), x);
            }
        }
    }
}

impl Entry for f64 {
    const TILE: usize = 2;

    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    unsafe fn tile(from: *const f64, from_width: usize, to: *mut f64, to_width: usize) {
        use std::arch::x86_64::*;

        // SAFETY: as the caller says; every x86-64 has these instructions.
        unsafe {
            let (a, b) = (_mm_loadu_pd(from), _mm_loadu_pd(from.add(from_width)));
            _mm_storeu_pd(to, _mm_unpacklo_pd(a, b));
            _mm_storeu_pd(to.add(to_width), _mm_unpackhi_pd(a, b));
        }
    }
}

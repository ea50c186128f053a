//! From numbers by instance to numbers by lane, and back.

/// The transpose of a table of `rows` rows and `columns` columns: `to[c * rows + r] = from[r * columns + c]`.
///
/// # Panics
/// If one of the slices is too short.
#[inline(always)]
pub fn transpose(from: &[f32], rows: usize, columns: usize, to: &mut [f32]) {
    let (from, to) = (&from[..rows * columns], &mut to[..rows * columns]);
    let tiled = [rows / TILE * TILE, columns / TILE * TILE];
    for r in (0..tiled[0]).step_by(TILE) {
        for c in (0..tiled[1]).step_by(TILE) {
            tile(&from[r * columns + c..], columns, &mut to[c * rows + r..], rows);
        }
    }
    // What is left: columns beside the tiles, rows below them.
    for r in 0..rows {
        let first = if r < tiled[0] { tiled[1] } else { 0 };
        for c in first..columns {
            to[c * rows + r] = from[r * columns + c];
        }
    }
}

/// Edge of the squares that are transposed at once.
const TILE: usize = 4;

/// Transposes a square in which rows are `from_width` and `to_width` apart.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
fn tile(from: &[f32], from_width: usize, to: &mut [f32], to_width: usize) {
    use std::arch::x86_64::*;

    let from = &from[..(TILE - 1) * from_width + TILE];
    let to = &mut to[..(TILE - 1) * to_width + TILE];
    // SAFETY: the four rows of either square lie within the slices just cut; every x86-64 has these instructions.
    unsafe {
        let row = |k: usize| _mm_loadu_ps(from.as_ptr().add(k * from_width));
        let (mut a, mut b, mut c, mut d) = (row(0), row(1), row(2), row(3));
        _MM_TRANSPOSE4_PS(&mut a, &mut b, &mut c, &mut d);
        for (k, x) in [a, b, c, d].into_iter().enumerate() {
            _mm_storeu_ps(to.as_mut_ptr().add(k * to_width), x);
        }
    }
}

#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
fn tile(from: &[f32], from_width: usize, to: &mut [f32], to_width: usize) {
    for r in 0..TILE {
        for c in 0..TILE {
            to[c * to_width + r] = from[r * from_width + c];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_entry_changes_places() {
        for rows in 1..=17 {
            for columns in 1..=45 {
                let from: Vec<f32> = (0..rows * columns).map(|k| k as f32).collect();
                let mut to = vec![-1.0; rows * columns];
                transpose(&from, rows, columns, &mut to);
                for r in 0..rows {
                    for c in 0..columns {
                        assert_eq!(to[c * rows + r], from[r * columns + c], "{rows} x {columns}: {r}, {c}");
                    }
                }
            }
        }
    }
}

//! Access to tables with one row per quantity and one column per instance.

use std::mem::MaybeUninit;

use super::number::{Lane, Real};

/// A group of columns of a table, one per lane.
pub struct Rows<'a, T> {
    /// The table; for dual numbers the rows of values, then the rows of slopes.
    pub numbers: &'a mut [T],
    /// Number of columns of the table.
    width: usize,
    /// First column of the group.
    first: usize,
}

impl<'a, T: Real> Rows<'a, T> {
    /// Columns of a block, starting at `first`.
    #[inline(always)]
    pub fn of_block(numbers: &'a mut [T], first: usize) -> Self {
        Self { numbers, width: T::BLOCK, first }
    }

    /// A table of one column.
    #[inline(always)]
    pub fn of_one(numbers: &'a mut [T]) -> Self {
        Self { numbers, width: 1, first: 0 }
    }

    /// A row; NaN beyond the table (a panic would need a call, which costs registers).
    #[inline(always)]
    pub fn get<L: Lane<Real = T>>(&self, row: usize) -> L {
        let numbers = L::read(self.numbers, row * self.width + self.first);
        debug_assert!(numbers.is_some(), "row {row}");
        if let Some(numbers) = numbers { numbers } else { L::c(f64::NAN) }
    }

    /// Sets a row; does nothing beyond the table.
    #[inline(always)]
    pub fn set<L: Lane<Real = T>>(&mut self, row: usize, x: L) {
        let at = row * self.width + self.first;
        debug_assert!(at + L::LANES <= self.numbers.len(), "row {row}");
        x.write(self.numbers, at);
    }

    /// Reads `count` rows from number `row` on into the first entries.
    #[inline(always)]
    pub fn get_some<L: Lane<Real = T>, const K: usize>(&self, row: usize, count: usize, to: &mut [L; K]) {
        for k in 0..count.min(K) {
            to[k] = self.get(row + k);
        }
    }

    /// Sets rows from number `row` on to the first `count` entries.
    #[inline(always)]
    pub fn set_some<L: Lane<Real = T>, const K: usize>(&mut self, row: usize, x: &[L; K], count: usize) {
        for k in 0..count.min(K) {
            self.set(row + k, x[k]);
        }
    }

    /// Reads K consecutive rows. (Sliced once, so that the compiler needs no further bounds checks.)
    #[inline(always)]
    pub fn get_all<L: Lane<Real = T>, const K: usize>(&self, row: usize) -> [L; K] {
        if L::SLOPES {
            let mut out = [L::zero(); K];
            unroll!(k < K => {
                out[k] = self.get(row + k);
            });
            return out;
        }
        let from = &self.numbers[row * self.width + self.first..][..(K - 1) * self.width + L::LANES];
        let mut out = MaybeUninit::<[L; K]>::uninit();
        unroll!(k < K => {
            // SAFETY: entry k of K.
            unsafe { out.as_mut_ptr().cast::<L>().add(k).write(L::load(&from[k * self.width..])) }
        });
        // SAFETY: all K entries are written.
        unsafe { out.assume_init() }
    }

    /// Sets K consecutive rows.
    #[inline(always)]
    pub fn set_all<L: Lane<Real = T>, const K: usize>(&mut self, row: usize, x: &[L; K]) {
        if L::SLOPES {
            unroll!(k < K => {
                self.set(row + k, x[k]);
            });
            return;
        }
        let to = &mut self.numbers[row * self.width + self.first..][..(K - 1) * self.width + L::LANES];
        unroll!(k < K => {
            x[k].store(&mut to[k * self.width..]);
        });
    }
}

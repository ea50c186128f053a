//! Tables with a row per quantity and a column per instance.

use super::{Lane, Real};

/// A group of columns of a table: as many as a lane is wide.
pub struct Rows<'a, T> {
    numbers: &'a mut [T],
    /// Columns of the table.
    width: usize,
    /// First column of the group.
    first: usize,
}

impl<'a, T: Real> Rows<'a, T> {
    /// Columns of a block, from column `first` on.
    #[inline(always)]
    pub fn of_block(numbers: &'a mut [T], first: usize) -> Self {
        Self { numbers, width: T::BLOCK, first }
    }

    /// A table of one column.
    #[inline(always)]
    pub fn of_one(numbers: &'a mut [T]) -> Self {
        Self { numbers, width: 1, first: 0 }
    }

    /// A row.
    #[inline(always)]
    pub fn get<L: Lane<Real = T>>(&self, row: usize) -> L {
        L::load(&self.numbers[row * self.width + self.first..])
    }

    /// Sets a row.
    #[inline(always)]
    pub fn set<L: Lane<Real = T>>(&mut self, row: usize, x: L) {
        x.store(&mut self.numbers[row * self.width + self.first..]);
    }

    /// Rows one after the other.
    #[inline(always)]
    pub fn get_all<L: Lane<Real = T>, const K: usize>(&self, row: usize) -> [L; K] {
        let mut out = [L::zero(); K];
        for k in 0..K {
            out[k] = self.get(row + k);
        }
        out
    }

    /// Sets rows one after the other.
    #[inline(always)]
    pub fn set_all<L: Lane<Real = T>, const K: usize>(&mut self, row: usize, x: &[L; K]) {
        for k in 0..K {
            self.set(row + k, x[k]);
        }
    }
}

//! Numbers of one instance in a table with a column per instance.

use crate::lane::Real;

/// One column of a table.
pub struct Column<'a, T> {
    numbers: &'a mut [T],
    /// Number of columns of the table.
    width: usize,
    /// Index of the column.
    at: usize,
}

impl<'a, T: Real> Column<'a, T> {
    /// Column `at` of a block.
    pub fn of_block(numbers: &'a mut [T], at: usize) -> Self {
        Self { numbers, width: T::BLOCK, at }
    }

    /// A table of one column.
    pub fn of_one(numbers: &'a mut [T]) -> Self {
        Self { numbers, width: 1, at: 0 }
    }

    /// Number in a row.
    pub fn get(&self, row: usize) -> f64 {
        self.numbers[row * self.width + self.at].to_f64()
    }

    /// Sets the number in a row.
    pub fn set(&mut self, row: usize, x: f64) {
        self.numbers[row * self.width + self.at] = T::from_f64(x);
    }

    /// Sets consecutive rows.
    pub(super) fn set_all(&mut self, row: usize, numbers: impl IntoIterator<Item = f64>) {
        for (k, x) in numbers.into_iter().enumerate() {
            self.set(row + k, x);
        }
    }

    /// Numbers in consecutive rows.
    pub(super) fn get_all<const K: usize>(&self, row: usize) -> [f64; K] {
        std::array::from_fn(|k| self.get(row + k))
    }
}

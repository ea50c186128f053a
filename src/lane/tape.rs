//! Tape of reverse differentiation: a stack of numbers in lanes.

use super::number::{Lane, Real};

/// Stack of numbers. Its memory is reserved before numbers are pushed, and stays.
#[derive(Debug, Clone, Default)]
pub struct Tape<T> {
    numbers: Vec<T>,
    at: usize,
}

impl<T: Real> Tape<T> {
    /// Removes all numbers.
    pub fn clear(&mut self) {
        self.at = 0;
    }

    /// Makes room for `count` more numbers of these lanes.
    #[inline(always)]
    pub fn reserve<L: Lane<Real = T>>(&mut self, count: usize) {
        if self.at + count * L::LANES > self.numbers.len() {
            self.grow(self.at + count * L::LANES);
        }
    }

    #[cold]
    #[inline(never)]
    fn grow(&mut self, size: usize) {
        self.numbers.resize(2 * size, T::default());
    }

    /// Count of numbers.
    pub fn len(&self) -> usize {
        self.at
    }

    /// True for a tape without numbers.
    pub fn is_empty(&self) -> bool {
        self.at == 0
    }

    /// Count of further numbers for which memory is reserved.
    pub fn room(&self) -> usize {
        self.numbers.len() - self.at
    }

    /// Makes room for `count` more numbers, and not for more.
    pub fn reserve_exact(&mut self, count: usize) {
        if let Some(more) = count.checked_sub(self.room()) {
            self.numbers.reserve_exact(more);
            self.numbers.resize(self.at + count, T::default());
        }
    }

    /// Pushes the first `count` numbers; none beyond the room reserved.
    #[inline(always)]
    pub fn push<L: Lane<Real = T>>(&mut self, x: &[L], count: usize) {
        for k in 0..count.min(x.len()) {
            x[k].write(&mut self.numbers, self.at);
            self.at += L::LANES;
        }
    }

    /// Pops `count` numbers, in the order in which they were pushed; NaN below the first.
    #[inline(always)]
    pub fn pop<L: Lane<Real = T>>(&mut self, x: &mut [L], count: usize) {
        let count = count.min(x.len());
        self.at = self.at.wrapping_sub(count * L::LANES);
        for k in 0..count {
            let number = L::read(&self.numbers, self.at.wrapping_add(k * L::LANES));
            x[k] = if let Some(number) = number { number } else { L::c(f64::NAN) };
        }
    }
}

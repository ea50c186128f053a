//! Arrays aligned to cache lines.

use std::collections::TryReserveError;
use std::ops::{Deref, DerefMut};

/// Bytes of a cache line.
pub const LINE: usize = 64;

/// An array of fixed length that starts at a cache line. Rows of blocks are as long as a cache line, so that no load or store
/// of a row touches two.
#[derive(Debug)]
pub struct Aligned<T> {
    memory: Vec<T>,
    start: usize,
}

impl<T: Clone> Aligned<T> {
    /// `count` times `number`.
    ///
    /// # Errors
    /// If they do not fit into memory.
    pub fn filled(count: usize, number: T) -> Result<Self, TryReserveError> {
        let most = LINE / size_of::<T>();
        let mut memory = Vec::<T>::new();
        memory.try_reserve_exact(count.saturating_add(most))?;
        // Does not move from here on: the capacity is enough for all.
        let start = memory.as_ptr().align_offset(LINE).min(most);
        memory.resize(start + count, number);
        Ok(Self { memory, start })
    }
}

impl<T: Clone> Clone for Aligned<T> {
    fn clone(&self) -> Self {
        let Some(first) = self.first() else { return Self { memory: Vec::new(), start: 0 } };
        let mut copy = Self::filled(self.len(), first.clone()).expect("as much memory as there is already");
        copy.clone_from_slice(self);
        copy
    }
}

impl<T> Deref for Aligned<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.memory[self.start..]
    }
}

impl<T> DerefMut for Aligned<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.memory[self.start..]
    }
}

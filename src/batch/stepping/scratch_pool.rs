//! Pool of scratch buffers.

use std::any::Any;
use std::sync::Mutex;

/// Pool of scratch buffers that are not in use: allocating them anew for every few blocks, or for every call of a single
/// instance, would show. A caller that finds the pool locked allocates its own. Buffers keep the numbers of their last user:
/// write before reading.
#[derive(Debug, Default)]
pub struct ScratchPool(Mutex<Vec<Box<dyn Any + Send>>>);

impl ScratchPool {
    /// Most buffers that are kept; of more threads than that some allocate theirs anew.
    const MOST: usize = 64;

    /// A buffer of this type, if there is one.
    pub fn take<M: Any>(&self) -> Option<Box<M>> {
        self.0.try_lock().ok()?.pop()?.downcast().ok()
    }

    /// Returns a buffer.
    pub fn put<M: Any + Send>(&self, buffer: Box<M>) {
        if let Ok(mut buffers) = self.0.try_lock()
            && buffers.len() < Self::MOST
        {
            buffers.push(buffer);
        }
    }
}

/// A copy is empty.
impl Clone for ScratchPool {
    fn clone(&self) -> Self {
        Self::default()
    }
}

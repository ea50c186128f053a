//! Sharing work among threads.

use std::sync::Mutex;

/// Calls `work` on all items, on up to `threads` threads. Which thread does what has no influence on the result.
/// Threads live for the call only: nothing to go wrong across a fork.
pub fn for_each<I: Send>(items: impl ExactSizeIterator<Item = I> + Send, threads: usize, work: impl Fn(I) + Sync) {
    let threads = threads.min(items.len());
    if threads <= 1 {
        return items.for_each(work);
    }
    let items = Mutex::new(items);
    let turn = || {
        loop {
            // A poisoned lock means that another thread panicked: its panic is raised by the scope.
            let Ok(Some(item)) = items.lock().map(|mut items| items.next()) else { break };
            work(item);
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads {
            // Where no more threads are to be had, those that there are do the work.
            let _ = std::thread::Builder::new().spawn_scoped(scope, turn);
        }
        turn();
    });
}

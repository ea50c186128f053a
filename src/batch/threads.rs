//! Sharing blocks among threads.

use std::sync::Mutex;

/// Blocks that a thread takes at a time.
const CHUNK: usize = 8;

/// Calls `work` on all blocks of `rows`, a few at a time, on up to `threads` threads. Which thread does what has no
/// influence on the result. Threads live for the call only: nothing to go wrong across a fork.
pub fn for_each_chunk<T: Send>(rows: &mut [T], block: usize, threads: usize, work: impl Fn(usize, &mut [T]) + Sync) {
    let blocks = rows.len() / block;
    let threads = threads.min(blocks.div_ceil(CHUNK));
    if threads <= 1 {
        return work(0, rows);
    }
    let chunks = Mutex::new(rows.chunks_mut(CHUNK * block).enumerate());
    let turn = || {
        loop {
            // A poisoned lock means that another thread panicked: its panic is raised by the scope.
            let Ok(Some((i, chunk))) = chunks.lock().map(|mut chunks| chunks.next()) else { break };
            work(i * CHUNK, chunk);
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

//! Work sharing among threads.
//!
//! One pool per process, made on first use; its threads sleep when idle. A fork copies no threads, so a child process makes
//! another pool. Nothing here waits for a lock that another thread may have held at the moment of the fork.

use std::hint::spin_loop;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{self, Thread, available_parallelism};
use std::time::{Duration, Instant};

use once_cell::race::OnceBox;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::limits::interrupt;

/// Time that a thread which has finished spins for the others before it sleeps: mostly they finish within it, and sleeping
/// and waking takes as long.
const PATIENCE: Duration = Duration::from_micros(50);

/// Calls `work` on all items, on up to `threads` threads: this one, and idle ones of the pool. The assignment of items to
/// threads does not influence the result. A panic in `work` is raised here, once all threads are done. All of them take part in the
/// computation of this one ([`interrupt::requested`]), which goes on asking while it waits.
pub fn for_each<I: Send>(items: impl ExactSizeIterator<Item = I> + Send, threads: usize, work: impl Fn(I) + Sync) {
    let helpers = threads.min(items.len()).saturating_sub(1);
    let busy = AtomicUsize::new(0);
    let engaged = if helpers == 0 { None } else { Pool::of_this_process().engage(helpers, &busy) };
    let Some((pool, engaged)) = engaged else { return items.for_each(work) };
    let watch = interrupt::current();
    let items = Mutex::new(items);
    let turn = || {
        loop {
            // A poisoned lock means that another thread panicked: its panic is raised by the scope.
            let Ok(Some(item)) = items.lock().map(|mut items| items.next()) else { break };
            work(item);
        }
    };
    pool.in_place_scope(|scope| {
        for mut helper in engaged {
            let (turn, watch) = (&turn, watch.clone());
            helper.waiting = watch.is_some().then(thread::current);
            scope.spawn(move |_| {
                let _until_done = (helper, interrupt::join(watch));
                turn();
            });
        }
        turn();
        let done = Instant::now();
        while busy.load(Ordering::Acquire) > 0 && done.elapsed() < PATIENCE {
            spin_loop();
        }
        while watch.is_some() && busy.load(Ordering::Acquire) > 0 {
            interrupt::requested();
            thread::park_timeout(interrupt::INTERVAL);
        }
    });
}

/// The threads of one process.
struct Pool {
    process: u32,
    /// None where no threads could be started.
    threads: Option<ThreadPool>,
    idle: AtomicUsize,
    /// Pool of a child of the process, which has a copy of this one without its threads.
    child: OnceBox<Pool>,
}

/// A thread of the pool while it works.
struct Helper<'a> {
    idle: &'a AtomicUsize,
    busy: &'a AtomicUsize,
    /// The thread that waits for it and asks for interrupts.
    waiting: Option<Thread>,
}

impl Drop for Helper<'_> {
    fn drop(&mut self) {
        self.idle.fetch_add(1, Ordering::Relaxed);
        self.busy.fetch_sub(1, Ordering::Release);
        if let Some(waiting) = &self.waiting {
            waiting.unpark();
        }
    }
}

impl Pool {
    /// One thread fewer than there are cores, and at least one.
    fn new(process: u32) -> Self {
        let helpers = available_parallelism().map_or(1, |cores| (cores.get() - 1).max(1));
        let name = |i| format!("uvms-gym-{i}");
        let threads = ThreadPoolBuilder::new().num_threads(helpers).thread_name(name).build().ok();
        let idle = AtomicUsize::new(if threads.is_some() { helpers } else { 0 });
        Self { process, threads, idle, child: OnceBox::new() }
    }

    /// The pool of this process. Two threads that need it first at once make it twice, and drop one, rather than wait for
    /// each other.
    fn of_this_process() -> &'static Self {
        static FIRST: OnceBox<Pool> = OnceBox::new();
        let process = std::process::id();
        let make = || Box::new(Self::new(process));
        let mut pool = FIRST.get_or_init(make);
        while let Some(child) = pool.child.get() {
            pool = child;
        }
        if pool.process == process { pool } else { pool.child.get_or_init(make) }
    }

    /// Up to `most` idle threads, counted in `busy` while they work. Only threads that can start at once: a task that waits
    /// in a queue could not be taken back.
    fn engage<'a>(
        &'a self,
        most: usize,
        busy: &'a AtomicUsize,
    ) -> Option<(&'a ThreadPool, impl Iterator<Item = Helper<'a>> + 'a)> {
        let threads = self.threads.as_ref()?;
        let take = |idle: usize| Some(idle - idle.min(most)).filter(|&rest| rest < idle);
        let before = self.idle.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take).ok()?;
        let engaged = before.min(most);
        busy.store(engaged, Ordering::Relaxed);
        Some((threads, (0..engaged).map(move |_| Helper { idle: &self.idle, busy, waiting: None })))
    }
}

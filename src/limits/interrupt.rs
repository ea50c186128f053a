//! Interrupts of long computations: the thread that begins one asks whether to go on, and all its threads stop.

use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, ThreadId};
use std::time::{Duration, Instant};

/// Time between two questions.
pub const INTERVAL: Duration = Duration::from_millis(50);

/// A computation that may be interrupted.
pub struct Watch {
    stopped: AtomicBool,
    /// Thread that asks.
    thread: ThreadId,
    /// Time of the last question, and the question.
    ask: Mutex<(Instant, Box<dyn FnMut() -> bool + Send>)>,
}

thread_local! {
    static CURRENT: RefCell<Option<Arc<Watch>>> = const { RefCell::new(None) };
}

/// Puts the watch before it back at its end.
pub struct Joined(Option<Arc<Watch>>);

impl Drop for Joined {
    fn drop(&mut self) {
        CURRENT.set(self.0.take());
    }
}

/// The computation of this thread, if it may be interrupted.
pub fn current() -> Option<Arc<Watch>> {
    CURRENT.with_borrow(Clone::clone)
}

/// Makes this thread take part in a computation, until the result is dropped.
#[must_use]
pub fn join(watch: Option<Arc<Watch>>) -> Joined {
    Joined(CURRENT.replace(watch))
}

/// Runs a computation that asks `go_on` about every [`INTERVAL`], on this thread, at its calls of [`requested`], and ends early
/// where the answer is false. Its result then means nothing.
pub fn watched<R>(go_on: impl FnMut() -> bool + Send + 'static, work: impl FnOnce() -> R) -> R {
    let (stopped, thread) = (AtomicBool::new(false), thread::current().id());
    let watch = Watch { stopped, thread, ask: Mutex::new((Instant::now(), Box::new(go_on))) };
    let _until_done = join(Some(Arc::new(watch)));
    work()
}

/// True where the computation of this thread is to end. To be called every few milliseconds at least; takes some 50 ns.
pub fn requested() -> bool {
    current().is_some_and(|watch| watch.requested())
}

impl Watch {
    fn requested(&self) -> bool {
        // The question may run code that computes itself: nothing waits for the lock.
        if !self.stopped.load(Ordering::Relaxed)
            && thread::current().id() == self.thread
            && let Ok(mut ask) = self.ask.try_lock()
            && ask.0.elapsed() >= INTERVAL
        {
            if !(ask.1)() {
                self.stopped.store(true, Ordering::Relaxed);
            }
            ask.0 = Instant::now();
        }
        self.stopped.load(Ordering::Relaxed)
    }
}

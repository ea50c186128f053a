//! Sharing work among threads.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::channel;
use std::thread::{available_parallelism, yield_now};
use std::time::{Duration, Instant};

use uvms_gym::batch::insides::for_each;

/// Number of calls on each of `count` items.
fn calls(count: usize, threads: usize) -> Vec<usize> {
    let calls: Vec<AtomicUsize> = (0..count).map(|_| AtomicUsize::new(0)).collect();
    for_each(calls.iter(), threads, |item| {
        item.fetch_add(1, Ordering::Relaxed);
    });
    calls.into_iter().map(AtomicUsize::into_inner).collect()
}

#[test]
fn work_is_called_once_on_each_item_whatever_the_threads() {
    for count in [0, 1, 2, 3, 16, 1000] {
        for threads in [0, 1, 2, 3, 8, 100] {
            assert_eq!(calls(count, threads), vec![1; count], "{threads} threads");
        }
    }
}

/// True where two items are worked on at the same time.
fn two_at_once() -> bool {
    let (within, began) = (AtomicUsize::new(0), Instant::now());
    let met = AtomicUsize::new(0);
    for_each(0..2, 2, |_| {
        within.fetch_add(1, Ordering::Relaxed);
        while within.load(Ordering::Relaxed) < 2 && began.elapsed() < Duration::from_secs(1) {
            yield_now();
        }
        met.fetch_add(usize::from(began.elapsed() < Duration::from_secs(1)), Ordering::Relaxed);
    });
    met.into_inner() == 2
}

#[test]
fn several_threads_work_where_they_may() {
    // Other tests may have engaged the pool.
    assert!((0..15).any(|_| two_at_once()));
}

#[test]
fn calls_within_calls_and_from_many_threads_at_once_come_to_an_end() {
    std::thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| {
                for _ in 0..50 {
                    for_each(0..5, 3, |_| assert_eq!(calls(7, 4), [1; 7]));
                }
            });
        }
    });
}

#[test]
fn a_long_call_does_not_hold_up_a_short_one() {
    let cores = available_parallelism().unwrap().get();
    let (started, stop, done) = (channel(), channel::<()>(), channel());
    let stopped = Mutex::new(stop.1);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            // Every thread of this call waits until the short one has ended.
            for_each(0..4 * cores, cores.max(2), |_| {
                started.0.send(()).unwrap();
                let _ = stopped.lock().unwrap().recv();
            });
        });
        started.1.recv().unwrap();
        scope.spawn(|| {
            calls(100, 2);
            done.0.send(()).unwrap();
        });
        let came = done.1.recv_timeout(Duration::from_secs(20));
        drop(stop.0);
        came.expect("the short call to end first");
    });
}

#[test]
fn a_panic_of_the_work_is_raised_and_leaves_the_threads_in_order() {
    for culprit in 0..20 {
        let run = || for_each(0..20, 2, |i| assert!(i != culprit, "culprit {i}"));
        let panic = catch_unwind(AssertUnwindSafe(run)).unwrap_err();
        assert_eq!(panic.downcast_ref::<String>(), Some(&format!("culprit {culprit}")));
    }
    assert!((0..15).any(|_| two_at_once()));
}

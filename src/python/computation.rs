//! Computations without the interpreter's lock.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};

use pyo3::PyClass;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::pyclass::boolean_struct::False;

use uvms_gym::limits::interrupt::watched;

/// Runs `work` without the lock.
///
/// # Errors
/// `RuntimeError` for a panic, which is a fault of this package.
pub fn detached<R: Send>(py: Python<'_>, work: impl FnOnce() -> R + Send) -> PyResult<R> {
    py.detach(|| catch_unwind(AssertUnwindSafe(work))).map_err(|panic| {
        let text = text(&*panic);
        PyRuntimeError::new_err(format!("internal error, a fault of uvms_gym, which should be reported: {text}"))
    })
}

/// As [`detached`]; a signal (Ctrl-C) ends the work within a tenth of a second.
///
/// # Errors
/// As [`detached`]; the exception of a signal's handler.
pub fn interruptible<R: Send>(py: Python<'_>, work: impl FnOnce() -> R + Send) -> PyResult<R> {
    let raised = Arc::new(Mutex::new(None));
    let place = raised.clone();
    let go_on = move || {
        let checked = Python::attach(|py| py.check_signals());
        checked.map_err(|error| *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(error)).is_ok()
    };
    let result = detached(py, || watched(go_on, work))?;
    match raised.lock().unwrap_or_else(PoisonError::into_inner).take() {
        Some(error) => Err(error),
        None => Ok(result),
    }
}

/// Access to an object.
///
/// # Errors
/// `RuntimeError` where another thread changes it.
pub fn shared<'py, T: PyClass>(object: &Bound<'py, T>) -> PyResult<PyRef<'py, T>> {
    object.try_borrow().map_err(|_| busy(object))
}

/// Access to an object for changes.
///
/// # Errors
/// `RuntimeError` where another thread uses it.
pub fn exclusive<'py, T: PyClass<Frozen = False>>(object: &Bound<'py, T>) -> PyResult<PyRefMut<'py, T>> {
    object.try_borrow_mut().map_err(|_| busy(object))
}

fn busy<T>(object: &Bound<'_, T>) -> PyErr {
    let name = object.as_any().get_type().name().map_or_else(|_| "object".to_owned(), |name| name.to_string());
    PyRuntimeError::new_err(format!(
        "this {name} is at work in another thread: wait for that call to end, or give each thread a copy of its own"
    ))
}

/// Message of a panic.
fn text(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or(panic.downcast_ref::<&str>().copied()).unwrap_or("unknown")
}

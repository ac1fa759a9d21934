//! Ctrl-C in long work: the work looks for it through its progress.

use pyo3::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

/// Runs `work` without the interpreter's lock. `work` calls its argument now and then; a signal
/// whose handler raises, as Ctrl-C does, ends it there.
///
/// The work is unwound rather than asked to return, because the library's loops have no way out of
/// their own. Unwinding drops everything that the work owns; no panic message is printed.
///
/// # Errors
/// The exception of the handler: `KeyboardInterrupt`.
pub fn interruptible<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&mut dyn FnMut(f64)) -> T + Send,
) -> PyResult<T> {
    let worked = py.detach(|| {
        catch_unwind(AssertUnwindSafe(|| {
            work(&mut |_share| {
                if let Err(raised) = Python::attach(|py| py.check_signals()) {
                    resume_unwind(Box::new(raised));
                }
            })
        }))
    });
    worked.map_err(|cause| match cause.downcast::<PyErr>() {
        Ok(raised) => *raised,
        // A panic of the library, which pyo3 turns into an exception.
        Err(panic) => resume_unwind(panic),
    })
}

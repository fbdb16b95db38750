//! Floor 1. Ctrl-C during long work.

use crate::errors::Result;
use pyo3::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Duration;

/// Set when the user interrupts.
pub struct StopFlag(AtomicBool);

impl StopFlag {
    /// Stop as if the user interrupted.
    pub fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }
    #[inline(always)]
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Run `work` without the interpreter lock; Ctrl-C stops it.
pub fn interruptible<R: Send>(
    py: Python<'_>,
    work: impl FnOnce(&StopFlag) -> Result<R> + Send,
) -> Result<R> {
    let stop = StopFlag(AtomicBool::new(false));
    let (result, signal) = py.detach(|| {
        std::thread::scope(|scope| {
            let (done, finished) = mpsc::channel::<()>();
            let stop = &stop;
            let worker = scope.spawn(move || {
                let result = work(stop);
                drop(done);
                result
            });
            let mut signal = Ok(());
            while matches!(
                finished.recv_timeout(Duration::from_millis(50)),
                Err(mpsc::RecvTimeoutError::Timeout)
            ) {
                if signal.is_ok() {
                    #[allow(clippy::redundant_closure_for_method_calls)]
                    // its lifetime does not unify
                    let checked = Python::attach(|py| py.check_signals());
                    signal = checked;
                    if signal.is_err() {
                        stop.set();
                    }
                }
            }
            (worker.join(), signal)
        })
    });
    signal?;
    result.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

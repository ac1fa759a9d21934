//! The queue between a run and the thread that writes its recording, bounded by bytes.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Largest number of bytes that wait before images are dropped: 1.8 s of 3 x 640 x 480 px at 60 per
/// second.
pub const IMAGE_BYTES: usize = 96 << 20;

/// Largest number of bytes that wait. Messages without images still fit when images do not.
pub const BYTES: usize = 128 << 20;

/// Memory that each entry takes beside its content, bytes.
const OVERHEAD: usize = 64;

/// Behaviour of a full queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// Time is real: an entry that does not fit is dropped and counted.
    Real,
    /// Time is virtual and waits with the run: nothing is dropped.
    Virtual,
}

/// Queue of entries.
///
/// ```
/// use std::time::Duration;
/// use trinocular_recording::queue::{BYTES, Pace, Popped, Queue};
///
/// let queue = Queue::new(Pace::Real);
/// assert!(queue.push("status", 100, false));
/// // What does not fit is dropped: a run never waits for the disk.
/// assert!(!queue.push("image", BYTES, true));
/// assert_eq!(queue.pop(Duration::ZERO), Popped::Entry("status"));
/// queue.close();
/// assert_eq!(queue.pop(Duration::ZERO), Popped::Closed);
/// ```
#[derive(Debug)]
pub struct Queue<T> {
    state: Mutex<State<T>>,
    /// Signals that entries have come or gone.
    changed: Condvar,
    pace: Pace,
}

#[derive(Debug)]
struct State<T> {
    entries: VecDeque<(T, usize)>,
    bytes: usize,
    is_closed: bool,
}

/// Result of [`Queue::pop`].
#[derive(Debug, PartialEq, Eq)]
pub enum Popped<T> {
    /// The oldest entry.
    Entry(T),
    /// No entry came in time.
    Nothing,
    /// The queue is closed and empty.
    Closed,
}

impl<T> Queue<T> {
    /// Makes an empty queue.
    pub fn new(pace: Pace) -> Self {
        Self {
            state: Mutex::new(State {
                entries: VecDeque::new(),
                bytes: 0,
                is_closed: false,
            }),
            changed: Condvar::new(),
            pace,
        }
    }

    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Appends an entry of this size; `is_image` sets its bound. Returns false if it was dropped.
    pub fn push(&self, entry: T, size: usize, is_image: bool) -> bool {
        let most = if is_image { IMAGE_BYTES } else { BYTES };
        let size = size + OVERHEAD;
        let mut state = self.lock();
        loop {
            if state.is_closed {
                return false;
            }
            // An entry alone fits always.
            if state.entries.is_empty() || state.bytes + size <= most {
                break;
            }
            if self.pace == Pace::Real {
                return false;
            }
            state = self
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
        state.bytes += size;
        state.entries.push_back((entry, size));
        self.changed.notify_all();
        true
    }

    /// Takes the oldest entry, or waits for one.
    pub fn pop(&self, patience: Duration) -> Popped<T> {
        let is_idle = |state: &mut State<T>| state.entries.is_empty() && !state.is_closed;
        let waited = self
            .changed
            .wait_timeout_while(self.lock(), patience, is_idle);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        match state.entries.pop_front() {
            Some((entry, size)) => {
                state.bytes -= size;
                self.changed.notify_all();
                Popped::Entry(entry)
            }
            None if state.is_closed => Popped::Closed,
            None => Popped::Nothing,
        }
    }

    /// Takes no further entry; those that wait are still popped.
    pub fn close(&self) {
        self.lock().is_closed = true;
        self.changed.notify_all();
    }

    /// Takes no further entry and forgets those that wait; returns their number.
    pub fn abandon(&self) -> usize {
        let mut state = self.lock();
        state.is_closed = true;
        state.bytes = 0;
        let count = state.entries.len();
        state.entries.clear();
        self.changed.notify_all();
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn full_queue_drops_in_real_time() {
        let queue = Queue::new(Pace::Real);
        assert!(queue.push(1, IMAGE_BYTES - OVERHEAD, true));
        assert!(!queue.push(2, 10, true));
        // Other messages have room left.
        assert!(queue.push(3, 10, false));
        assert!(!queue.push(4, BYTES - IMAGE_BYTES, false));
        assert_eq!(queue.pop(Duration::ZERO), Popped::Entry(1));
        assert!(queue.push(5, 10, true));
        queue.close();
        assert!(!queue.push(6, 10, true));
        let rest = [Popped::Entry(3), Popped::Entry(5), Popped::Closed];
        assert_eq!([0; 3].map(|_| queue.pop(Duration::ZERO)), rest);
    }

    #[test]
    fn full_queue_waits_in_virtual_time() {
        let queue = Arc::new(Queue::new(Pace::Virtual));
        assert!(queue.push(0, IMAGE_BYTES, true));
        let writer = {
            let queue = Arc::clone(&queue);
            std::thread::spawn(move || (1..100).all(|n| queue.push(n, IMAGE_BYTES / 2, true)))
        };
        for expected in 0..100 {
            assert_eq!(queue.pop(Duration::from_secs(60)), Popped::Entry(expected));
        }
        assert!(writer.join().expect("no panic"));
        assert_eq!(queue.pop(Duration::ZERO), Popped::Nothing);
        assert_eq!(queue.abandon(), 0);
        assert!(!queue.push(1, 1, false));
    }
}

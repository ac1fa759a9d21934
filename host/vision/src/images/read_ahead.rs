//! Items that a thread of its own makes ahead of their reader, such as frame sets of a recording.

use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::{JoinHandle, spawn};
use std::time::Duration;

/// Next item of a [`ReadAhead`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next<T> {
    /// The item.
    Item(T),
    /// None came within the time.
    NotYet,
    /// There are no more.
    End,
}

/// Reader of items that a thread makes. The thread ends with its next item once this is dropped.
///
/// ```
/// use std::time::Duration;
/// use trinocular_vision::images::read_ahead::{Next, ReadAhead};
///
/// let mut numbers = ReadAhead::start(2, |send| {
///     for number in 0..3 {
///         if send.send(number).is_err() {
///             return; // The reader is gone.
///         }
///     }
/// });
/// let patience = Duration::from_secs(60);
/// for number in 0..3 {
///     assert_eq!(numbers.next_within(patience), Next::Item(number));
/// }
/// assert_eq!(numbers.next_within(patience), Next::End);
/// ```
#[derive(Debug)]
pub struct ReadAhead<T> {
    items: Receiver<T>,
    /// `None` after the end.
    thread: Option<JoinHandle<()>>,
}

impl<T: Send + 'static> ReadAhead<T> {
    /// Starts the thread, which makes up to `ahead` items before they are read.
    pub fn start(ahead: usize, make: impl FnOnce(&SyncSender<T>) + Send + 'static) -> Self {
        let (sender, items) = sync_channel(ahead);
        Self {
            items,
            thread: Some(spawn(move || make(&sender))),
        }
    }

    /// Returns the next item, waiting for it at most this long.
    ///
    /// # Panics
    /// With the thread's own panic, if it ended by one: that is no end of the items.
    pub fn next_within(&mut self, patience: Duration) -> Next<T> {
        match self.items.recv_timeout(patience) {
            Ok(item) => Next::Item(item),
            Err(RecvTimeoutError::Timeout) => Next::NotYet,
            Err(RecvTimeoutError::Disconnected) => {
                if let Some(thread) = self.thread.take() {
                    thread.join().unwrap_or_else(|panic| resume_unwind(panic));
                }
                Next::End
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    const PATIENCE: Duration = Duration::from_secs(60);

    #[test]
    fn panic_of_the_thread_is_no_end() {
        let mut items = ReadAhead::start(1, |send| {
            let _ = send.send(1);
            resume_unwind(Box::new("broken"));
        });
        assert_eq!(items.next_within(PATIENCE), Next::Item(1));
        let panic = catch_unwind(AssertUnwindSafe(|| items.next_within(PATIENCE))).unwrap_err();
        assert_eq!(panic.downcast_ref(), Some(&"broken"));
        assert_eq!(items.next_within(PATIENCE), Next::End);
    }

    #[test]
    fn slow_thread_is_waited_for() {
        let (go, wait) = sync_channel(0);
        let mut items = ReadAhead::start(1, move |send| {
            let number: i32 = wait.recv().unwrap();
            let _ = send.send(number);
        });
        assert_eq!(items.next_within(Duration::ZERO), Next::NotYet);
        go.send(7).unwrap();
        assert_eq!(items.next_within(PATIENCE), Next::Item(7));
    }

    #[test]
    fn thread_ends_without_its_reader() {
        let (told, ended) = sync_channel(1);
        let items = ReadAhead::start(0, move |send| {
            let refused = send.send(1).is_err();
            told.send(refused).unwrap();
        });
        drop(items);
        assert_eq!(ended.recv_timeout(PATIENCE), Ok(true));
    }
}

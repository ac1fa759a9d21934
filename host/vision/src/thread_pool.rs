//! Thread pool for the same work on many items.
//!
//! *Invariant:* results come in the order of their items, on any number of threads.

use std::sync::Arc;

use rayon::ThreadPoolBuilder;
use rayon::iter::{IntoParallelIterator, ParallelIterator};

/// Runs work inline, or on a persistent work-stealing pool. Clones share the pool.
///
/// ```
/// use trinocular_vision::thread_pool::ThreadPool;
///
/// let squares = ThreadPool::new(2).map(vec![1, 2, 3], |n| n * n);
/// assert_eq!(squares, [1, 4, 9]);
/// ```
#[derive(Clone, Debug, Default)]
pub struct ThreadPool(Option<Arc<rayon::ThreadPool>>);

impl ThreadPool {
    /// Starts `threads` threads. With less than two, or if the system cannot start any, work runs
    /// on the calling thread.
    pub fn new(threads: usize) -> Self {
        let pool = || ThreadPoolBuilder::new().num_threads(threads).build().ok();
        let several = (threads > 1).then(pool).flatten();
        Self(several.map(Arc::new))
    }

    /// Returns the number of threads that work.
    pub fn count(&self) -> usize {
        let pool = self.0.as_ref();
        pool.map_or(1, |pool| pool.current_num_threads())
    }

    /// Runs `work` on one of the threads. Every [`ThreadPool::map`] in it starts without waking the
    /// pool first.
    pub fn run<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &self.0 {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }

    /// Applies `work` to every item and returns the results in order.
    pub fn map<T: Send, R: Send>(
        &self,
        items: Vec<T>,
        work: impl Fn(T) -> R + Send + Sync,
    ) -> Vec<R> {
        match &self.0 {
            Some(pool) => pool.install(|| items.into_par_iter().map(work).collect()),
            None => items.into_iter().map(work).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_keep_result_order() {
        let items: Vec<u32> = (0..230).collect();
        let expected: Vec<u32> = items.iter().map(|i| i * i).collect();
        for threads in [0, 1, 2, 3, 22] {
            let thread_pool = ThreadPool::new(threads);
            assert_eq!(thread_pool.count(), threads.max(1));
            let squares = thread_pool.map(items.clone(), |i| i * i);
            assert_eq!(squares, expected, "{threads}");
            // Work on an item may use the pool, too.
            let sums = thread_pool
                .run(|| thread_pool.map(vec![3, 5], |n| thread_pool.map(vec![n; 4], |i| i + 1)));
            assert_eq!(sums, [vec![4; 4], vec![6; 4]], "{threads}");
            assert!(thread_pool.map(Vec::new(), |i: u32| i).is_empty());
        }
    }

    #[test]
    fn single_thread_is_the_callers() {
        let here = std::thread::current().id();
        for (threads, alone) in [(1, true), (2, false)] {
            let place = ThreadPool::new(threads).run(|| std::thread::current().id());
            assert_eq!(place == here, alone);
        }
    }
}

//! The same work on many items, on a few threads.
//!
//! *Invariant:* results come in the order of their items, whoever has done them and when.

use std::sync::Arc;

use rayon::iter::{IntoParallelIterator, ParallelIterator};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Who shares the work: the caller alone, or threads that wait for it. What one has not begun,
/// another may take over.
#[derive(Clone, Debug, Default)]
pub struct Workers(Option<Arc<ThreadPool>>);

impl Workers {
    /// So many threads; with less than two, or if the system has none left, the caller does it all.
    pub fn new(threads: usize) -> Self {
        let pool = || ThreadPoolBuilder::new().num_threads(threads).build().ok();
        let several = (threads > 1).then(pool).flatten();
        Self(several.map(Arc::new))
    }

    /// How many work.
    pub fn count(&self) -> usize {
        let pool = self.0.as_ref();
        pool.map_or(1, |pool| pool.current_num_threads())
    }

    /// `work` as one of them: every [`Workers::map`] in it begins without waking anybody first.
    pub fn run<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &self.0 {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }

    /// `work` on every item, in order.
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
    fn results_keep_their_order_whatever_the_number_of_threads() {
        let items: Vec<u32> = (0..230).collect();
        let expected: Vec<u32> = items.iter().map(|i| i * i).collect();
        for threads in [0, 1, 2, 3, 22] {
            let workers = Workers::new(threads);
            assert_eq!(workers.count(), threads.max(1));
            let squares = workers.map(items.clone(), |i| i * i);
            assert_eq!(squares, expected, "{threads}");
            // Each item's work may itself be shared.
            let sums =
                workers.run(|| workers.map(vec![3, 5], |n| workers.map(vec![n; 4], |i| i + 1)));
            assert_eq!(sums, [vec![4; 4], vec![6; 4]], "{threads}");
            assert!(workers.map(Vec::new(), |i: u32| i).is_empty());
        }
    }

    #[test]
    fn one_alone_stays_on_the_callers_thread_and_several_do_not() {
        let here = std::thread::current().id();
        for (threads, alone) in [(1, true), (2, false)] {
            let place = Workers::new(threads).run(|| std::thread::current().id());
            assert_eq!(place == here, alone);
        }
    }
}

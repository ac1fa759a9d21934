//! The same work on many items, on a few threads.

use std::thread;

/// `work` on every item, in order. Each thread takes an equal share of the items, one after the other, so results do not depend on how many
/// there are.
pub fn map<T: Send, R: Send>(
    threads: usize,
    mut items: Vec<T>,
    work: impl Fn(T) -> R + Sync,
) -> Vec<R> {
    let share = items.len().div_ceil(threads.max(1)).max(1);
    let mut shares = Vec::new();
    while items.len() > share {
        let rest = (items.len() - 1) / share * share;
        shares.push(items.split_off(rest));
    }
    let one = |items: Vec<T>| items.into_iter().map(&work).collect::<Vec<R>>();
    if shares.is_empty() {
        return one(items);
    }
    thread::scope(|scope| {
        let spawn = |items| scope.spawn(|| one(items));
        let others: Vec<_> = shares.into_iter().rev().map(spawn).collect();
        let mut results = one(items);
        for other in others {
            match other.join() {
                Ok(more) => results.extend(more),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
        results
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_keep_their_order_whatever_the_number_of_threads() {
        let items: Vec<u32> = (0..23).collect();
        let expected: Vec<u32> = items.iter().map(|i| i * i).collect();
        for threads in [0, 1, 2, 3, 22, 23, 100] {
            let squares = map(threads, items.clone(), |i| i * i);
            assert_eq!(squares, expected, "{threads}");
        }
        assert!(map(3, Vec::new(), |i: u32| i).is_empty());
    }
}

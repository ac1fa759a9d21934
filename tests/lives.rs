//! Random lives of a healthy stage: no fault with any target and cameras.
//!
//! ```text
//! cargo test -p trinocular-tests --test lives -- --ignored --nocapture
//! ```
//! runs ten thousand lives and prints the number that ended with a fault.

#[path = "lives/life.rs"]
mod life;

use life::Life;
use std::num::NonZero;
use std::sync::atomic::{AtomicU64, Ordering};

/// Follows the lives of a range of seeds on all processors. Returns descriptions of the lives that
/// ended with a fault.
fn faults(seeds: std::ops::Range<u64>) -> Vec<String> {
    let threads = std::thread::available_parallelism().map_or(1, NonZero::get);
    let next = AtomicU64::new(seeds.start);
    let work = || {
        let mut faults = Vec::new();
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= seeds.end {
                return faults;
            }
            let mut life = Life::new(seed);
            if let Some(fault) = life.follow() {
                faults.push(format!("{fault:?} in life {seed}: {}", life.story));
            }
        }
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        let joined = workers.into_iter().map(|worker| worker.join());
        joined
            .flat_map(|faults| faults.expect("no panic"))
            .collect()
    })
}

#[test]
fn healthy_stage_survives_300_lives() {
    let faults = faults(0..300);
    assert_eq!(faults, Vec::<String>::new());
}

#[test]
#[ignore = "ten thousand lives take two minutes; tests/run --all includes it"]
fn healthy_stage_survives_10000_lives() {
    const LIVES: u64 = 10_000;
    let faults = faults(0..LIVES);
    // The rule of three: with 95 % confidence the rate is below 3/n if there was none in n.
    println!(
        "{} of {LIVES} healthy lives ended with a fault",
        faults.len()
    );
    assert_eq!(faults, Vec::<String>::new());
}

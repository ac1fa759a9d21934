//! Random lives of the station, judged by what its pins do. See `campaign --help`.

mod frames;
mod judge;
mod laws;
mod life;
mod pins;
mod random;
mod shell;
mod stages;

use std::panic::{AssertUnwindSafe, catch_unwind};
use judge::Counts;
use laws::{Law, Violation};

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let n: u64 = args[1].parse().unwrap();
    let s: u64 = args[2].parse().unwrap();
    let trace = args.len() > 3;
    let mut counts = Counts::default();
    let mut hits = std::collections::BTreeMap::<&str, Vec<(u64, Violation)>>::new();
    for seed in s..s + n {
        let fate = catch_unwind(AssertUnwindSafe(|| life::live(seed, trace)));
        match fate {
            Ok(f) => { counts.add(&f.counts); for v in f.violations { hits.entry(v.law.name()).or_default().push((seed, v)); } }
            Err(_) => { hits.entry("panic").or_default().push((seed, Violation { law: Law::Panic, at_ms: 0.0, text: String::new() })); }
        }
    }
    println!("{counts:?}");
    for (k, v) in hits { println!("{k}: {}", v.len()); for (s, x) in v.iter().take(6) { println!("   {s} {:.3} {}", x.at_ms, x.text); } }
}

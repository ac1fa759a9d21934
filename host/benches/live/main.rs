//! Cost of the live page, and the time from its STOP to the last step edge.
//!
//! `cargo bench -p trinocular --bench live` prints the tables of `host/benches/live/README.md`. Linux
//! only: the processor time of the threads comes from `/proc`.

mod cost;
mod stop;

fn main() {
    // `cargo test --bench` only checks that everything runs.
    let is_bench = std::env::args().any(|argument| argument == "--bench");
    let (seconds, stops) = if is_bench { (20, 200) } else { (1, 3) };
    cost::run(seconds);
    stop::run(stops);
}

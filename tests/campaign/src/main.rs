//! Random lives of the station, judged by its pins.
//!
//! There are two kinds: *station* lives with any commands, noise, switches and stalls, and *loop*
//! lives that follow a target through a plant. The seed determines the life, which is the same on
//! every machine.

mod following;
mod frames;
mod judge;
mod laws;
mod life;
mod options;
mod page;
mod pins;
mod random;
mod sabotage;
mod scene;
mod shell;
mod stages;
mod tally;

use laws::{Law, Violation};
use life::Fate;
use options::{CampaignOptions, Kind};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;
use tally::Tally;

fn main() -> ExitCode {
    let options = match CampaignOptions::parse(std::env::args().skip(1)) {
        Ok(options) => options,
        Err(message) => {
            eprintln!("campaign: {message} (try --help)");
            return ExitCode::from(2);
        }
    };
    if options.help {
        print!("{}", options::HELP);
        return ExitCode::SUCCESS;
    }
    if let Some(seed) = options.replay {
        let fate = live(&options, seed, true);
        return match fate.violations.is_empty() {
            true => ExitCode::SUCCESS,
            false => ExitCode::from(1),
        };
    }
    // Panics are counted instead of printed in full a thousand times.
    std::panic::set_hook(Box::new(|_| ()));
    let (text, violations) = match options.markdown {
        true => page(&options),
        false => {
            let tally = run(&options);
            (
                tally.summary(&options),
                tally.violations_but(&options.counted),
            )
        }
    };
    print!("{text}");
    match violations {
        0 => ExitCode::SUCCESS,
        _ => ExitCode::from(1),
    }
}

/// Runs both kinds and returns the page with the number of lives that broke a law.
fn page(options: &CampaignOptions) -> (String, u64) {
    let kinds = [
        (Kind::Station, options.lives),
        (Kind::Loop, options.loop_lives),
    ];
    let parts = kinds.map(|(kind, lives)| {
        let options = CampaignOptions {
            kind,
            lives,
            ..options.clone()
        };
        let begin = Instant::now();
        let tally = run(&options);
        (
            tally.markdown(&options, begin.elapsed().as_secs()),
            tally.violations(),
        )
    });
    let [(station, a), (following, b)] = parts;
    (
        format!("{}{station}{following}{}", page::HEAD, page::foot(options)),
        a + b,
    )
}

/// Runs all lives on several threads.
fn run(options: &CampaignOptions) -> Tally {
    let next = AtomicU64::new(0);
    let tally = Mutex::new(Tally::new(options.kind));
    let begin = Instant::now();
    std::thread::scope(|scope| {
        for _ in 0..options.threads {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= options.lives {
                        break;
                    }
                    let seed = options.seed + number;
                    let fate = live(options, seed, false);
                    let mut tally = tally.lock().expect("no thread panics while it counts");
                    for line in tally.add(seed, fate) {
                        eprintln!("{line}");
                    }
                    if tally.lives.is_multiple_of(options.progress) && tally.lives < options.lives {
                        let seconds = begin.elapsed().as_secs();
                        let (lives, violations) = (tally.lives, tally.violations());
                        eprintln!("{lives} lives, {violations} violations, {seconds} s");
                    }
                }
            });
        }
    });
    tally
        .into_inner()
        .expect("no thread panics while it counts")
}

/// Runs one life. A panic counts as a violation.
fn live(options: &CampaignOptions, seed: u64, trace: bool) -> Fate {
    let live = || match options.kind {
        Kind::Station => life::live_with(seed, trace, options.sabotage),
        Kind::Loop => following::live(seed, trace),
    };
    catch_unwind(AssertUnwindSafe(live)).unwrap_or_else(|cause| {
        let text = cause.downcast_ref::<String>().cloned();
        let text = text.or_else(|| cause.downcast_ref::<&str>().map(|text| text.to_string()));
        Fate {
            counts: judge::Counts::default(),
            violations: vec![Violation {
                law: Law::Panic,
                at_ms: 0.0,
                text: text.unwrap_or_default(),
            }],
        }
    })
}

//! Scenario files with any edits.
//!
//! Laws: no panic; an error names the file; a scenario ends within an hour.
#![no_main]

use libfuzzer_sys::fuzz_target;
use station_fuzz::edit::{Edit, edited};
use station_fuzz::law::check_error;
use std::path::Path;
use trinocular::scenario::file::Scenario;

const GOOD: [&str; 4] = [
    include_str!("../../scenarios/switches.toml"),
    include_str!("../../scenarios/frames.toml"),
    include_str!("../../scenarios/lissajous.toml"),
    include_str!("../../scenarios/occlusion.toml"),
];

fuzz_target!(|input: (u8, Vec<Edit>)| {
    let (which, edits) = input;
    let file = Path::new("some/scenario.toml");
    let good = GOOD[usize::from(which) % GOOD.len()];
    let Ok(text) = String::from_utf8(edited(good, &edits)) else {
        return;
    };
    match Scenario::parse(file, &text) {
        Ok(scenario) => assert!((0.0..=3_600.0).contains(&scenario.seconds())),
        Err(error) => check_error(&error, &[file]),
    }
});

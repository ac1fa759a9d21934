//! Scenarios: each meets its expectations, is the same in every run and on an emulated Cortex-M4;
//! and the command's messages about bad files.

#[path = "simulate/command.rs"]
mod command;

use std::path::{Path, PathBuf};
use trinocular::scenario::figures::Figures;
use trinocular::scenario::file::{ImageSource, Scenario};
use trinocular::scenario::run::{Run, ScenarioOptions, run};
use trinocular_tests::replaying::{BOARD, Recording};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios")
}

fn read(name: &str) -> Scenario {
    Scenario::read(&folder().join(name)).unwrap_or_else(|error| panic!("{error}"))
}

fn files() -> Vec<String> {
    let entries = std::fs::read_dir(folder()).expect("the scenarios' folder");
    let names = entries.map(|entry| entry.expect("an entry").file_name());
    let mut names: Vec<String> = names
        .map(|name| name.into_string().expect("a plain name"))
        .filter(|name| name.ends_with(".toml"))
        .collect();
    names.sort();
    names
}

fn live(scenario: &Scenario, prediction: bool) -> Run {
    let options = ScenarioOptions {
        prediction,
        board: BOARD.name,
        record: true,
    };
    run(scenario, options, |_| {}).unwrap_or_else(|error| panic!("{error}"))
}

/// Returns the expectations that a scenario does not meet.
fn missed(scenario: &Scenario) -> Vec<String> {
    let figures = |prediction| {
        let run = live(scenario, prediction);
        (Figures::of(scenario, &run.trace), run.trace)
    };
    let (with, trace) = figures(true);
    let gain = scenario.expect.prediction_gain;
    let without = gain.map(|_| figures(false).0);
    scenario.missed(&trace, &with, without.as_ref())
}

/// Rendered scenarios take a minute and are a stage of their own in `tests/run`. With points in
/// place of images they must meet the same expectations.
#[test]
fn scenarios_meet_expectations_on_points() {
    let names = files();
    assert!(names.len() >= 8, "{names:?}");
    let mut all = Vec::new();
    for name in &names {
        let missed = missed(&read(name).with_points());
        all.extend(missed.into_iter().map(|what| format!("{name}: {what}")));
    }
    assert!(all.is_empty(), "{}", all.join("\n"));
}

#[test]
fn runs_repeat_exactly_per_seed() {
    let mut scenario = read("frames.toml");
    let [first, second] = [live(&scenario, true), live(&scenario, true)];
    assert_eq!(first.trace, second.trace);
    let log = |run: &Run| Recording::of(&run.twin).log;
    assert_eq!(log(&first), log(&second));
    scenario.seed += 1;
    assert_ne!(log(&first), log(&live(&scenario, true)));
}

/// A scenario that misses its expectations is reported: each bound, one at a time, just below the
/// measured value.
#[test]
fn each_bound_is_judged() {
    let mut scenario = read("step.toml").with_points();
    // Measure over the jumps, so that no figure is zero.
    scenario.measure.from_s = 0.0;
    let run = live(&scenario, true);
    let figures = Figures::of(&scenario, &run.trace);
    let judged = |change: &dyn Fn(&mut Scenario)| {
        let mut strict = scenario.clone();
        change(&mut strict);
        strict.missed(&run.trace, &figures, None).join("; ")
    };
    let below = |v: [f64; 3]| Some(v.map(|x| x * 0.99));
    let settle_ms = figures.settle_ms.expect("it settles");
    let overshoot = figures.overshoot.expect("there is a jump");
    let p99 = figures.latency_ms.p99.expect("frames were used");
    for (name, text) in [
        (
            "rms_mm[2]",
            judged(&|s| s.expect.rms_mm = below(figures.rms_mm)),
        ),
        (
            "max_mm[2]",
            judged(&|s| s.expect.max_mm = below(figures.max_mm)),
        ),
        (
            "lag_mm",
            judged(&|s| s.expect.lag_mm = Some(figures.lag_mm * 0.99)),
        ),
        (
            "settle_ms",
            judged(&|s| s.expect.settle_ms = Some(settle_ms - 1.0)),
        ),
        (
            "overshoot",
            judged(&|s| s.expect.overshoot = Some(overshoot - 0.001)),
        ),
        (
            "jitter_mm[2]",
            judged(&|s| s.expect.jitter_mm = below(figures.jitter_mm)),
        ),
        (
            "latency_ms.p99",
            judged(&|s| s.expect.latency_ms = Some(p99 * 0.99)),
        ),
        (
            "steps[1]",
            judged(&|s| s.expect.steps = Some([figures.steps[0], 99_999, 0])),
        ),
        (
            "faults",
            judged(&|s| s.expect.faults = vec![trinocular_core::safety::Fault::Limit]),
        ),
        ("states", judged(&|s| s.expect.states = Some(Vec::new()))),
        (
            "speed_mm_s[0]",
            judged(&|s| s.stage.max_speed_mm_s[0] = 10.0),
        ),
        (
            "acceleration_mm_s2[1]",
            judged(&|s| s.stage.max_acceleration_mm_s2[1] = 500.0),
        ),
    ] {
        assert!(text.contains(name), "{name}: {text}");
    }
    let mut lost = figures.clone();
    lost.lost = 1;
    let missed = scenario.missed(&run.trace, &lost, None);
    assert_eq!(missed[0], "lost is 1, must be 0");
}

#[test]
fn scenario_replays_match_twin() {
    for name in files() {
        println!("{name}");
        Recording::of(&live(&read(&name).with_points(), true).twin).check_here();
    }
}

fn agree_in_qemu(name: &str) {
    let scenario = read(name);
    // The station does not know the source of its sums.
    let scenario = match scenario.cameras.sight {
        ImageSource::Rendered { .. } => scenario.with_points(),
        ImageSource::Points { .. } => scenario,
    };
    let [segments, packets] = Recording::of(&live(&scenario, true).twin).check_emulated();
    println!("{name}: {segments} segments and {packets} packets agree");
}

/// Defines a test per scenario, and the list of their files.
macro_rules! in_qemu {
    ($($test:ident: $file:literal)*) => {
        const EMULATED: &[&str] = &[$($file),*];
        $(
            #[test]
            #[ignore = "needs QEMU and a thumbv7em compiler; tests/run includes it"]
            fn $test() {
                agree_in_qemu($file);
            }
        )*
    };
}

#[test]
fn emulated_scenarios_are_complete() {
    let mut emulated = EMULATED.to_vec();
    emulated.sort_unstable();
    assert_eq!(files(), emulated);
}

in_qemu! {
    the_emulated_processor_agrees_on_a_step: "step.toml"
    the_emulated_processor_agrees_on_a_lissajous_figure: "lissajous.toml"
    the_emulated_processor_agrees_on_a_line: "line.toml"
    the_emulated_processor_agrees_on_slow_frames: "slow.toml"
    the_emulated_processor_agrees_on_turns: "turns.toml"
    the_emulated_processor_agrees_on_a_vibration: "vibration.toml"
    the_emulated_processor_agrees_on_noise: "still.toml"
    the_emulated_processor_agrees_on_an_occlusion: "occlusion.toml"
    the_emulated_processor_agrees_on_a_covered_target: "covered.toml"
    the_emulated_processor_agrees_on_a_silent_host: "heartbeat.toml"
    the_emulated_processor_agrees_on_bad_frames: "frames.toml"
    the_emulated_processor_agrees_on_switches: "switches.toml"
}

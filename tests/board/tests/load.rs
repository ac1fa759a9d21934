//! Load of the processor. The table is in LOADS.md:
//!
//! ```sh
//! REGENERATE=1 cargo test --manifest-path tests/board/Cargo.toml --test load
//! ```

use station_board::board::Make;
use station_board::image::Image;
use station_board::order::jog;
use station_board::reference::agreement;
use station_board::scene;
use station_board::station::Station;
use station_board::time::{MS, US};
use std::fmt::Write as _;
use std::path::Path;
use trinocular_core::frame::message::{Command, Trigger};
use trinocular_rig::rig_file::Driver;

/// Largest share of time that the processor may be busy while following 200 frames per second with
/// the flash's waits.
const LARGEST_LOAD: f64 = 0.45;

/// Load of the processor during one activity.
#[derive(Clone, Copy)]
struct Load {
    /// Millions of instructions per second, which is instructions per port word.
    instructions: f64,
    /// Share of the time during which the processor is awake.
    busy: f64,
}

fn load(station: &mut Station, act: impl FnOnce(&mut Station)) -> Load {
    let counts = |station: &Station| {
        let board = &station.board;
        (board.now(), board.busy(), board.instructions())
    };
    let before = counts(station);
    act(station);
    let after = counts(station);
    let time = (after.0 - before.0) as f64;
    Load {
        instructions: (after.2 - before.2) as f64 / (time / US as f64),
        busy: (after.1 - before.1) as f64 / time,
    }
}

const NAMES: [&str; 5] = [
    "not configured",
    "at rest",
    "jog of three axes at full speed",
    "following 200 frames per second over the UART",
    "the same, with 200 triggers per second",
];

fn loads(flash_waits: bool) -> [Load; 5] {
    let make = Make {
        flash_waits,
        ..Make::default()
    };
    let mut station = Station::power_on(&Image::firmware(), make);
    station.run(20 * MS);
    station.greet();
    let unconfigured = load(&mut station, |station| station.run(200 * MS));
    station.set_up(Driver::Tmc2209);
    let rest = load(&mut station, |station| station.run(300 * MS));
    assert_eq!(station.command(jog([25_000; 3])), Ok(()));
    station.run(50 * MS);
    let moving = load(&mut station, |station| station.run(150 * MS));
    station.run(200 * MS);
    let following = load(&mut station, |station| scene::follow(station, 200));
    assert_eq!(station.command(Command::Stop), Ok(()));
    station.run(300 * MS);
    // However long each instruction takes, the reports and edges are the same.
    agreement(&mut station);
    let triggering = triggering(make);
    [unconfigured, rest, moving, following, triggering]
}

/// Returns the load of a station that follows and triggers the cameras.
fn triggering(make: Make) -> Load {
    let mut station = Station::power_on(&Image::firmware(), make);
    station.run(20 * MS);
    station.greet();
    station.set_up(Driver::Tmc2209);
    let trigger = Command::Trigger(Trigger {
        rate_hz: 200,
        pulse_us: 1_000,
        active_low: false,
        quiet_us: 0,
    });
    assert_eq!(station.command(trigger), Ok(()));
    let load = load(&mut station, |station| scene::follow(station, 200));
    agreement(&mut station);
    load
}

/// Text before the rows of the table.
const HEAD: &str = "\
# Processor load of the image

The flashed image on the emulated STM32F405 at 168 MHz, by the interpreter's count of instructions
and cycles, with a port word every microsecond: millions of instructions per second are instructions
per word. *With waits* adds a model of the flash's five wait states, its prefetch and its caches
(`src/chip/flash.rs`). This file is renewed by

```sh
REGENERATE=1 cargo test --manifest-path tests/board/Cargo.toml --test load
```

| what the station does | instructions per word | busy | busy with waits |
|---|---:|---:|---:|
";

fn table(without: &[Load; 5], with: &[Load; 5]) -> String {
    let mut text = String::from(HEAD);
    for ((name, without), with) in NAMES.iter().zip(without).zip(with) {
        let percent = |load: &Load| 100.0 * load.busy;
        let _ = writeln!(
            text,
            "| {name} | {:.1} | {:.0} % | {:.0} % |",
            without.instructions,
            percent(without),
            percent(with)
        );
    }
    text
}

#[test]
fn following_leaves_spare_load() {
    let (without, with) = (loads(false), loads(true));
    let text = table(&without, &with);
    println!("{text}");
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("LOADS.md");
    if std::env::var_os("REGENERATE").is_some() {
        std::fs::write(&file, &text).expect("LOADS.md can be written");
    }
    let [_, _, moving, following, triggering] = with;
    assert!(following.busy <= LARGEST_LOAD, "{:.3}", following.busy);
    assert!(moving.busy <= LARGEST_LOAD, "{:.3}", moving.busy);
    assert!(triggering.busy <= LARGEST_LOAD, "{:.3}", triggering.busy);
    for (without, with) in without.iter().zip(&with) {
        assert!(without.busy < with.busy, "waits cost something");
    }
}

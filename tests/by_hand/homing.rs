//! `home`: the switches, and what ends it early.

use super::{CONFIGURE, Desk, PATIENCE};
use serde_json::json;
use std::time::{Duration, Instant};
use trinocular_tests::binary::interrupt;
use trinocular_tests::far_end::station;

/// The rails have switches at 70 mm either way from the stage's starting point.
#[test]
fn homing_finds_the_switches() {
    let end = station();
    let desk = Desk::new(&end.path);
    desk.run(&format!("home {CONFIGURE}"))
        .ended(3, &["no home switch", "home_switch in the rig file"]);
    desk.run(&format!("jog x=11 {CONFIGURE}"))
        .ended(3, &["home or zero first", "unknown_window_mm"]);
    let home = "--rig home.toml --heartbeat 5000";
    let done = desk.run(&format!("home {home}"));
    done.ended(0, &["-59.0", "59.0", "known"]);
    // The stage backs off 2 mm from 70 mm. At 2 mm/s the station polls the switch every 0.16 steps.
    for (steps, side) in end.steps().into_iter().zip([-1, 1, -1]) {
        assert!((steps - side * 5_440).abs() <= 1, "{steps}");
    }
    assert_eq!(desk.status()["trust"], "homed");
    let jog = desk.run(&format!("jog x=59 y=-59 z=59 {home} --json"));
    let at = jog.ended(0, &[]).json();
    for steps in at["position_steps"].as_array().expect("three axes") {
        assert!(steps.as_i64().expect("steps").abs() <= 1, "{at}");
    }
    // The switches determine the middle, 9 mm from the start.
    for (steps, side) in end.steps().into_iter().zip([-1, 1, -1]) {
        assert!((steps - side * 720).abs() <= 1, "{steps}");
    }
    let done = desk.run("home Z --json").ended(0, &[]).json();
    assert_eq!(done["trust"], "homed");
    assert_eq!(done["state"], "idle");
}

#[test]
fn interrupted_homing_stops_on_ramp() {
    let end = station();
    let desk = Desk::new(&end.path);
    let home = desk.start("home x --rig home.toml --heartbeat 5000");
    let patience = Instant::now() + PATIENCE;
    while end.steps()[0] > -80 {
        assert!(Instant::now() < patience, "{:?}", end.steps());
        std::thread::sleep(Duration::from_millis(5));
    }
    interrupt(&home);
    let done = home.wait_with_output().expect("it ends");
    assert_eq!(done.status.code(), Some(3));
    let stood = end.standing();
    let status = desk.status();
    assert_eq!(status["state"], "stopped");
    assert_eq!(status["trust"], "unknown");
    assert_eq!(status["position_steps"], json!(stood));
}

//! `serve --port`: what it changes at a station that is there before it.

use super::rig_with_default_stage;
use serde_json::Value;
use std::time::Duration;
use trinocular_client::serial::Serial;
use trinocular_client::stage::{configuration, default_stage};
use trinocular_core::frame::message::{Command, Mounting, Packet};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::safety::{Fault, State, Trust};
use trinocular_tests::binary::{Outcome, trinocular};
use trinocular_tests::far_end::{FarEnd, station};

/// A heartbeat timeout that a busy test machine does not exceed.
const HEARTBEAT: [&str; 2] = ["--heartbeat", "5000"];

fn start(end: &FarEnd) -> Serial {
    let mut config = configuration(&default_stage(), Mounting::OnStage).expect("it fits");
    config.heartbeat_ms = 5_000;
    Serial::start_as(&end.path, config).expect("the station starts")
}

/// Starts the station and jogs it by 2 mm along X.
fn moved(end: &FarEnd) -> Serial {
    let mut serial = start(end);
    let distance_um = [2_000, 0, 0];
    serial.command("jog", Command::Jog { distance_um }).unwrap();
    serial.until_rest().expect("it arrives");
    serial
}

/// Serves the page of the station for a moment; returns what it says.
fn serve(end: &FarEnd, options: &[&str]) -> String {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut command = trinocular();
    command
        .args(["serve", "--listen", "127.0.0.1:0", "--seconds", "1"])
        .args(["--port", &end.path])
        .args(options);
    if !options.is_empty() {
        command
            .arg("--rig")
            .arg(rig_with_default_stage(folder.path()));
    }
    let outcome = Outcome::of(&mut command);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    outcome.stderr
}

/// Another stage's steps per mm would move the station otherwise than asked.
#[test]
fn page_with_control_needs_the_stage() {
    let end = station();
    drop(moved(&end));
    let (before, heard) = (status(&end), end.received().len());
    for option in ["--control", "--follow"] {
        let mut command = trinocular();
        command.args([
            "serve",
            option,
            "--listen",
            "127.0.0.1:0",
            "--port",
            &end.path,
        ]);
        Outcome::of(&mut command).failed(2, &["--rig", "[stage]", "only shows"]);
    }
    assert_eq!(end.received().len(), heard, "nothing was sent");
    let after = status(&end);
    assert_eq!(before["position_steps"], after["position_steps"]);
    assert_eq!(after["trust"], "homed");
}

fn status(end: &FarEnd) -> Value {
    let mut command = trinocular();
    command.args(["status", "--json", "--port", &end.path]);
    Outcome::of(&mut command).good_json().remove(0)
}

/// Returns the commands among the bytes that the station has received.
fn commands(mut bytes: &[u8]) -> Vec<Command> {
    let mut receiver = Receiver::<Packet>::default();
    let packets = std::iter::from_fn(|| receiver.next(&mut bytes));
    packets
        .filter_map(|packet| packet.ok().map(|packet| packet.command))
        .collect()
}

#[test]
fn page_that_only_shows_changes_nothing() {
    let end = station();
    let mut serial = moved(&end);
    serial.stop().expect("it is answered");
    drop(serial);
    let (before, heard) = (status(&end), end.received().len());
    let said = serve(&end, &[]);
    for command in commands(&end.received()[heard..]) {
        assert!(
            matches!(command, Command::Hello | Command::Ping { .. }),
            "{command:?}"
        );
    }
    for part in [
        "was not changed",
        "stopped",
        "80 steps/mm",
        "does not report",
    ] {
        assert!(said.contains(part), "`{part}` is not in: {said}");
    }
    let after = status(&end);
    for field in ["state", "trust", "position_steps", "motors"] {
        assert_eq!(before[field], after[field], "{field}");
    }
}

#[test]
fn page_shows_a_station_without_configuration() {
    let end = station();
    let said = serve(&end, &[]);
    for part in ["has no configuration", "--control"] {
        assert!(said.contains(part), "`{part}` is not in: {said}");
    }
    assert_eq!(status(&end)["state"], "unconfigured");
}

#[test]
fn page_with_control_keeps_zero() {
    let end = station();
    drop(moved(&end));
    let said = serve(&end, &[&["--control"][..], &HEARTBEAT].concat());
    for part in ["was configured with", "its position is known"] {
        assert!(said.contains(part), "`{part}` is not in: {said}");
    }
    let after = status(&end);
    assert_eq!(after["position_steps"], serde_json::json!([160, 0, 0]));
    assert_eq!(
        (&after["state"], &after["trust"]),
        (&"idle".into(), &"homed".into())
    );
}

#[test]
fn page_with_control_zeroes_unknown_position() {
    let end = station();
    let said = serve(&end, &[&["--control"][..], &HEARTBEAT].concat());
    assert!(said.contains("its present position is zero"), "{said}");
    assert_eq!(status(&end)["trust"], "homed");
}

#[test]
fn page_with_control_keeps_latched_fault() {
    let end = station();
    let mut config = configuration(&default_stage(), Mounting::OnStage).expect("it fits");
    config.heartbeat_ms = 500;
    let mut serial = Serial::start_as(&end.path, config).expect("the station starts");
    let distance_um = [50_000, 0, 0];
    serial.command("jog", Command::Jog { distance_um }).unwrap();
    serial.abandon();
    end.standing();
    std::thread::sleep(Duration::from_millis(600));
    let said = serve(&end, &[&["--control"][..], &HEARTBEAT].concat());
    assert!(said.contains("it is faulted"), "{said}");
    let serial = Serial::connect(&end.path).expect("the port is free");
    let after = serial.fresh_status(false).expect("a status comes");
    let condition = (after.state, after.fault, after.trust);
    let expected = (State::Faulted, Some(Fault::Heartbeat), Trust::Homed);
    assert_eq!(condition, expected);
}

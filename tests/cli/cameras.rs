//! `track --cameras` on a computer without cameras: errors name the problem and the remedy.

use std::fs;
use std::os::unix::fs::symlink;

use super::{Desk, run};

const DEVICES: &str = "/dev/no-left,/dev/no-middle,/dev/no-right";

fn track(desk: &Desk, more: &[&str]) -> super::Outcome {
    let mut arguments = vec!["track", "--cameras", DEVICES];
    arguments.extend(more);
    run(desk.folder.path(), &arguments)
}

#[test]
fn missing_device_is_named_with_remedy() {
    let advice = match cfg!(feature = "camera") {
        true => "no such camera: plug it in",
        false => "cargo build --release --features trinocular/camera",
    };
    let desk = Desk::new();
    track(&desk, &["--rig", "rig.toml"]).failed(1, &["/dev/no-left: ", advice]);
}

#[test]
fn mismatch_with_rig_fails_before_opening() {
    let desk = Desk::new();
    let two = ["track", "--cameras", "/dev/a,/dev/b", "--rig", "rig.toml"];
    let outcome = run(desk.folder.path(), &two);
    outcome.failed(2, &["2 devices", "3 cameras", "left, middle, right"]);
    assert_eq!(track(&desk, &[]).code, Some(2));
    // One device given twice is recognised under any name.
    let (left, middle) = (desk.path("left"), desk.path("middle"));
    fs::write(&left, "").expect("ours");
    symlink(&left, &middle).expect("ours");
    for devices in ["/dev/a,/dev/b,/dev/a", "left,/dev/b,middle"] {
        let twice = ["track", "--cameras", devices, "--rig", "rig.toml"];
        let outcome = run(desk.folder.path(), &twice);
        outcome.failed(2, &["one device twice", "for left and", "for right"]);
    }
    track(&desk, &["--rig", "rig.toml", "--window", "17"]).failed(2, &["--window is 17"]);
    track(&desk, &["--rig", "rig.toml", "--delay", "-101"]).failed(2, &["--delay is -101"]);
    // A real stage must be described in the rig file; no device is opened or moved.
    let port = ["--rig", "rig.toml", "--port", "/dev/no-port"];
    track(&desk, &port).failed(1, &["rig.toml", "[stage]"]);
    let fixed = ["--rig", "rig.toml", "--fixed"];
    track(&desk, &fixed).failed(2, &["--fixed goes with --cameras and --port"]);
    for option in [
        &["--fixed"][..],
        &["--window", "1"],
        &["--delay", "9"],
        &["--idle", "9"],
    ] {
        let words = [&["track", "--sim", "--seconds", "1"][..], option].concat();
        run(desk.folder.path(), &words).failed(2, &[option[0], "goes with"]);
    }
}

/// Returns a desk whose rig file has these lines in the table of its middle camera.
fn desk_with(lines: &str) -> Desk {
    let desk = Desk::new();
    let text = fs::read_to_string(desk.path("rig.toml")).expect("a rig file");
    let name = "name = \"middle\"\n";
    assert!(text.contains(name), "{text}");
    desk.write("rig.toml", text.replace(name, &format!("{name}{lines}\n")));
    desk
}

#[test]
fn rig_names_devices_or_the_error_says_how() {
    let with_rig = ["track", "--rig", "rig.toml", "--cameras", "rig"];
    let desk = desk_with("device = \"/dev/no-middle\"");
    let outcome = run(desk.folder.path(), &with_rig);
    let words = [
        "rig.toml:",
        "field `camera[0].device`: missing",
        "genicam:SERIAL",
    ];
    outcome.failed(1, &words);
    // The settings of a GenICam camera are refused for a V4L2 camera, with their line.
    let desk = desk_with("gain = 3");
    let outcome = track(&desk, &["--rig", "rig.toml"]);
    outcome.failed(
        1,
        &["rig.toml:11: field `camera[1].gain`: only GenICam cameras"],
    );
}

#[test]
fn genicam_cameras_are_absent_or_not_built_in() {
    let desk = Desk::new();
    let cameras = "genicam:no-1,genicam:no-2,genicam:no-3";
    let words = ["track", "--rig", "rig.toml", "--cameras", cameras];
    let advice = match cfg!(feature = "genicam") {
        true => "no such GenICam camera",
        false => "--features trinocular/genicam",
    };
    run(desk.folder.path(), &words).failed(1, &["genicam:no-1: ", advice]);
    let twice = [
        "track",
        "--rig",
        "rig.toml",
        "--cameras",
        "genicam:1,genicam:2,genicam:1",
    ];
    run(desk.folder.path(), &twice).failed(2, &["one device twice"]);
}

#[test]
fn cameras_are_listed_without_any() {
    let desk = Desk::new();
    let outcome = run(desk.folder.path(), &["cameras", "--json"]);
    let listing = &outcome.good_json()[0];
    let without = listing["without"].as_array().expect("a list");
    let is_without = |kind: &str| without.contains(&kind.into());
    assert_eq!(is_without("GenICam"), !cfg!(feature = "genicam"));
    assert_eq!(is_without("V4L2"), !cfg!(feature = "camera"));
    assert!(listing["cameras"].is_array(), "{listing}");
    let outcome = run(desk.folder.path(), &["cameras"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    assert!(!outcome.stdout.is_empty());
}

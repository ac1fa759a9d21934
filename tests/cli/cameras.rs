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

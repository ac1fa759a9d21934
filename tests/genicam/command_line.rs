//! The program with fake cameras: the list, the devices and settings of the rig file, and errors.

use super::fakes::{Fakes, SERIALS, has_interfaces};
use std::fs;
use tempfile::TempDir;
use trinocular_rig::rig_file::RigFile;
use trinocular_tests::binary::{Outcome, trinocular};

/// Settings with which the fake cameras' images are whole.
const GOOD: &str = "exposure_us = 10000\ngain = 0\npacket_size_bytes = 9000\npacket_delay_us = 1\n\
                    trigger_mode = \"Off\"\npacket_resend = false\nptp = false\n";

/// Returns a rig file that names the devices, and whose middle camera has these lines, too.
fn rig(lines: &str) -> String {
    let mut text = RigFile::paper().to_toml();
    let devices = ["GV03", "GV01", "GV02"];
    for (name, serial) in ["left", "middle", "right"].into_iter().zip(devices) {
        let own = if name == "middle" {
            lines
        } else {
            GOOD.trim_end()
        };
        let line = format!("name = \"{name}\"\n");
        let lines = format!("{line}device = \"genicam:{serial}\"\n{own}\n");
        text = text.replace(&line, &lines);
    }
    text
}

/// Returns the place of a line in the rig file, as errors name it.
fn place(lines: &str, line: &str) -> String {
    let text = rig(lines);
    let before = text.lines().take_while(|each| *each != line).count();
    format!("rig.toml:{}: field ", before + 1)
}

/// Runs `track` with this rig file.
fn track(lines: &str, more: &[&str]) -> Outcome {
    let folder: TempDir = tempfile::tempdir().expect("a folder");
    let text = rig(lines);
    fs::write(folder.path().join("rig.toml"), text).expect("a file of ours");
    let mut track = trinocular();
    track
        .args(["track", "--rig", "rig.toml", "--cameras"])
        .args(more)
        .current_dir(folder.path());
    Outcome::of(&mut track)
}

#[test]
#[ignore = "needs Debian's aravis-tools; tests/run includes it"]
fn cameras_are_listed_by_serial_number() {
    if !has_interfaces("command_line::cameras_are_listed_by_serial_number") {
        return;
    }
    let _fakes = Fakes::start(0);
    let listed = Outcome::of(trinocular().args(["cameras", "--json"]));
    let listing = &listed.good_json()[0];
    let cameras = listing["cameras"].as_array().expect("a list");
    let genicam = cameras
        .iter()
        .filter(|camera| camera["kind"] == "GigEVision");
    let genicam: Vec<_> = genicam.collect();
    assert_eq!(genicam.len(), 3, "{listing}");
    for (camera, serial) in genicam.iter().zip(SERIALS) {
        assert_eq!(camera["device"], format!("genicam:{serial}"));
        assert_eq!(
            (&camera["serial"], &camera["vendor"]),
            (&serial.into(), &"Aravis".into())
        );
        let formats = camera["formats"].as_array().expect("a list");
        assert!(formats.contains(&"Mono8".into()) && formats.contains(&"Mono16".into()));
        assert!(camera["problem"].is_null(), "{camera}");
    }
    let listed = Outcome::of(trinocular().arg("cameras"));
    assert!(
        listed
            .stdout
            .contains("genicam:GV02         GigEVision  Aravis  Fake  127.")
    );
}

/// The fake cameras' image, a ramp, has no points to follow.
#[test]
#[ignore = "needs Debian's aravis-tools; tests/run includes it"]
fn rig_file_names_and_sets_the_cameras() {
    if !has_interfaces("command_line::rig_file_names_and_sets_the_cameras") {
        return;
    }
    let _fakes = Fakes::start(0);
    for format in ["Mono8", "Mono16"] {
        let lines = format!("{GOOD}pixel_format = \"{format}\"");
        let outcome = track(&lines, &["rig", "--fps", "20", "--seconds", "4"]);
        let error = "the first frame set cannot be the keyframe";
        assert!(outcome.stderr.contains(error), "{}", outcome.stderr);
        let opened = format!(
            "left is genicam:GV03, Mono8\nmiddle is genicam:GV01, {format}\nright is genicam:GV02, \
             Mono8\n"
        );
        assert!(outcome.stderr.contains(&opened), "{}", outcome.stderr);
        for (name, serial) in [("left", "GV03"), ("middle", "GV01"), ("right", "GV02")] {
            let who = format!("{name} (genicam:{serial}): ");
            let source = format!("{who}images have the camera's time\n");
            assert!(outcome.stderr.contains(&source), "{}", outcome.stderr);
            let mut lines = outcome
                .stderr
                .lines()
                .filter_map(|line| line.strip_prefix(&who));
            let counts = lines
                .find(|line| line.contains(" images, "))
                .expect("counts");
            assert!(!counts.contains(", 0 used"), "{counts}");
            assert!(counts.contains(", 0 damaged, "), "{counts}");
        }
    }
}

#[test]
#[ignore = "needs Debian's aravis-tools; tests/run includes it"]
fn impossible_settings_name_line_and_range() {
    if !has_interfaces("command_line::impossible_settings_name_line_and_range") {
        return;
    }
    let _fakes = Fakes::start(0);
    for (line, words) in [
        (
            "exposure_us = 5e7",
            "`camera[1].exposure_us`: 50000000 is out of the camera's range (10 to 10000000 us)",
        ),
        (
            "gain = 11",
            "`camera[1].gain`: 11 is out of the camera's range (0 to 10)",
        ),
        (
            "pixel_format = \"Mono12p\"",
            "`camera[1].pixel_format`: the camera has no Mono12p; it has BayerBG8, ",
        ),
        ("ptp = true", "`camera[1].ptp`: the camera has no PTP"),
        (
            "bandwidth_mb_s = 9",
            "`camera[1].bandwidth_mb_s`: the camera has no such setting",
        ),
    ] {
        let outcome = track(line, &["rig"]);
        outcome.failed_after_notes(1, &[&(place(line, line) + words)]);
    }
    for (line, words) in [
        (
            "trigger_source = \"Line7\"",
            "`camera[1].trigger_source`: the camera has no `Line7`; it has Line0, Software",
        ),
        (
            "trigger_activation = \"AnyEdge\"",
            "`camera[1].trigger_activation`: the camera has no `AnyEdge`; it has RisingEdge",
        ),
    ] {
        let lines = format!("trigger_mode = \"On\"\n{line}");
        let outcome = track(&lines, &["rig"]);
        outcome.failed_after_notes(1, &[&(place(&lines, line) + words)]);
    }
}

#[test]
#[ignore = "needs Debian's aravis-tools; tests/run includes it"]
fn absent_and_silent_cameras_are_named() {
    if !has_interfaces("command_line::absent_and_silent_cameras_are_named") {
        return;
    }
    let _fakes = Fakes::start(0);
    let outcome = track("", &["genicam:GV01,genicam:GV09,genicam:GV02"]);
    let words = ["genicam:GV09: no such GenICam camera: found: GV01, GV02, GV03"];
    outcome.failed_after_notes(1, &words);
    // No edge ever comes on the line.
    let waiting = "trigger_mode = \"On\"\ntrigger_source = \"Line0\"\n\
                   trigger_activation = \"RisingEdge\"";
    let outcome = track(waiting, &["rig"]);
    outcome.failed_after_notes(1, &["genicam:GV01: no image for 3 s"]);
}

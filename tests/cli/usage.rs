//! Help, version, and invalid command lines.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::Stdio;

use super::{Desk, run, trinocular};

#[track_caller]
fn misused(arguments: &[&str]) {
    let outcome = run(Path::new("."), arguments);
    assert_eq!(outcome.code, Some(2), "{arguments:?}: {}", outcome.stderr);
    assert_eq!(outcome.stdout, "", "{arguments:?}");
    assert!(outcome.stderr.contains("Usage"), "{}", outcome.stderr);
}

#[test]
fn invalid_command_line_exits_2() {
    misused(&["no-such-command"]);
    misused(&["--no-such-option"]);
    misused(&["estimate"]);
    misused(&["estimate", "points.csv"]);
    misused(&["estimate", "--rig", "rig.toml"]);
    misused(&["estimate", "points.csv", "second.csv", "--rig", "rig.toml"]);
}

#[test]
fn unknown_option_value_exits_2() {
    let desk = Desk::new();
    for (option, known) in [("--method", "closed-form"), ("--reference", "previous")] {
        let outcome = desk.estimate(&[option, "guess"]);
        assert_eq!(outcome.code, Some(2));
        assert_eq!(outcome.stdout, "");
        assert!(outcome.stderr.contains(known), "{}", outcome.stderr);
    }
}

/// A number below its range is refused with the range, not taken for an option.
#[test]
fn negative_tolerance_is_refused_with_its_range() {
    let outcome = run(
        Path::new("."),
        &["estimate", "run.mcap", "--tolerance", "-1"],
    );
    assert_eq!(outcome.code, Some(2), "{}", outcome.stderr);
    assert!(
        outcome.stderr.contains("must be 0 to 1000 ms"),
        "{}",
        outcome.stderr
    );
}

#[test]
fn absent_feature_is_named_before_the_run() {
    let outcome = run(Path::new("."), &["track", "--sim", "--json", "--zenoh"]);
    assert_eq!(outcome.code, Some(2), "{}", outcome.stderr);
    assert_eq!(outcome.stdout, "");
    let way_out = "--features trinocular/zenoh";
    assert!(outcome.stderr.contains(way_out), "{}", outcome.stderr);
}

#[test]
fn version_and_help_exit_0() {
    let version = run(Path::new("."), &["-V"]);
    assert_eq!(version.code, Some(0));
    let expected = concat!("trinocular ", env!("CARGO_PKG_VERSION"), "\n");
    assert_eq!(version.stdout, expected);
    for arguments in [&["--help"][..], &["help"], &["estimate", "--help"]] {
        let help = run(Path::new("."), arguments);
        assert_eq!(help.code, Some(0), "{arguments:?}");
        assert!(help.stdout.contains("Usage: trinocular"), "{}", help.stdout);
        assert_eq!(help.stderr, "");
    }
}

#[test]
fn help_explains_every_option() {
    let help = run(Path::new("."), &["estimate", "--help"]).stdout;
    for part in [
        "--rig <RIG.toml>",
        "--method <METHOD>",
        "--reference <first|previous|FILE>",
        "--json",
        "[default: midpoint]",
        "[default: first]",
        "id,camera,x0,y0,x1,y1",
        "mm",
        "Examples:",
    ] {
        assert!(help.contains(part), "`{part}` is not in: {help}");
    }
    let top = run(Path::new("."), &["--help"]).stdout;
    assert!(top.contains("Exit codes:"), "{top}");
}

#[test]
fn closed_output_is_no_fault() {
    let desk = Desk::new();
    for arguments in [
        &["estimate", "points.csv", "--rig", "rig.toml"][..],
        &["--help"],
    ] {
        let mut child = trinocular()
            .args(arguments)
            .current_dir(desk.folder.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        // The reading end is closed before, or while, the program writes.
        drop(child.stdout.take());
        let stderr = BufReader::new(child.stderr.take().expect("piped"));
        let complaints: Vec<_> = stderr.lines().collect();
        let status = child.wait().expect("the program ends");
        assert_eq!(status.code(), Some(0), "{complaints:?}");
        assert!(complaints.is_empty(), "{complaints:?}");
    }
}

/// More images per second leave less time for the usual latency, and a run may end before there is
/// anything to summarise.
#[test]
fn track_fits_latency_to_frame_rate() {
    let short = ["track", "--sim", "--fps", "100", "--seconds", "0.5"];
    let outcome = run(Path::new("."), &short);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let said = "no image after the first second";
    assert!(outcome.stderr.contains(said), "{}", outcome.stderr);
    assert!(!outcome.stderr.contains("rms"), "{}", outcome.stderr);
    let late = [&short[..], &["--latency", "8"]].concat();
    run(Path::new("."), &late).failed(2, &["--latency is 8, must be 0 to 7"]);
}

#[test]
fn scene_out_of_range_names_option() {
    for (option, value) in [("--noise", "500"), ("--depth", "0"), ("--tilt", "90")] {
        let mut arguments = vec!["track", "--sim", option, value];
        if option == "--tilt" {
            arguments.push("0");
        }
        run(Path::new("."), &arguments).failed(2, &[option, value, "must be"]);
    }
}

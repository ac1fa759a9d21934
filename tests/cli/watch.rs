//! `track --watch`: a folder that grows during the run gives the same result as a complete one.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::path::Path;
use std::process::{Child, Stdio};
use std::thread::sleep;
use std::time::Duration;

use serde_json::Value;
use trinocular_tests::binary::signal;

use super::folder::{AT_REST, desk_with_views};
use super::{Desk, run, trinocular};

const NAMES: [&str; 3] = ["left", "middle", "right"];

/// Displacements of a steady motion, which the station takes for no outlier.
const MOVES_MM: [Option<[f64; 3]>; 4] = [
    AT_REST,
    Some([0.3, 0.2, -0.1]),
    Some([0.6, 0.4, -0.2]),
    Some([0.9, 0.6, -0.3]),
];

fn watching(desk: &Desk, more: &[&str]) -> Child {
    let watch = ["track", "--watch", "growing", "--rig", "rig.toml", "--json"];
    trinocular()
        .args(watch)
        .args(more)
        .current_dir(desk.folder.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts")
}

/// Adds a frame set to the growing folder as a slow camera program does: half a file, a pause
/// longer than the settling time, and the rest.
fn give(desk: &Desk, number: usize) {
    for name in NAMES {
        let view = Path::new(name).join(format!("{number:04}.pgm"));
        let bytes = fs::read(desk.path("views").join(&view)).expect("it was drawn");
        fs::create_dir_all(desk.path("growing").join(name)).expect("ours");
        let mut file = fs::File::create(desk.path("growing").join(&view)).expect("ours");
        let (first, rest) = bytes.split_at(bytes.len() / 2);
        file.write_all(first).expect("ours");
        if name == "middle" {
            sleep(Duration::from_millis(400));
        }
        file.write_all(rest).expect("ours");
    }
}

/// Returns the rest of standard error and the exit code.
fn end(mut child: Child) -> (Option<i32>, String) {
    let mut text = String::new();
    let mut stderr = child.stderr.take().expect("piped");
    stderr.read_to_string(&mut text).expect("UTF-8");
    (child.wait().expect("it ends").code(), text)
}

#[test]
fn growing_folder_equals_complete_one() {
    let desk = desk_with_views(&MOVES_MM);
    let images = ["track", "--images", "views", "--rig", "rig.toml", "--json"];
    let complete = run(desk.folder.path(), &images).good_json();
    assert_eq!(complete.len(), 3);

    fs::create_dir(desk.path("growing")).expect("ours");
    let mut child = watching(&desk, &["--idle", "4"]);
    let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines();
    give(&desk, 0);
    for (number, expected) in (1..).zip(&complete) {
        give(&desk, number);
        // Add the next frame set only after the program has followed this one.
        let line = lines.next().expect("a line").expect("UTF-8");
        let line: Value = serde_json::from_str(&line).expect("JSON");
        assert_eq!(&line, expected);
    }
    assert!(lines.next().is_none());
    let (code, text) = end(child);
    assert_eq!(code, Some(0), "{text}");
    assert!(
        text.contains("Ctrl-C ends") && text.contains("came to rest"),
        "{text}"
    );
}

#[test]
fn signal_ends_run_cleanly() {
    for (name, expected) in [("INT", 130), ("TERM", 143)] {
        let desk = desk_with_views(&MOVES_MM[..2]);
        fs::rename(desk.path("views"), desk.path("growing")).expect("ours");
        let mut child = watching(&desk, &[]);
        let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines();
        assert!(lines.next().expect("a line").is_ok());
        signal(&child, name);
        let (code, text) = end(child);
        assert_eq!(code, Some(expected), "{text}");
        assert!(text.contains("came to rest"), "{text}");
        assert!(!text.contains("error"), "{text}");
    }
}

#[test]
fn bad_or_missing_files_are_named() {
    let desk = desk_with_views(&MOVES_MM[..3]);
    desk.write("views/right/0001.pgm", "P5\n320 240\n255\ntoo short");
    let watch = [
        "track", "--watch", "views", "--rig", "rig.toml", "--idle", "1",
    ];
    let images = ["track", "--images", "views", "--rig", "rig.toml"];
    // An unreadable frame set is named and does not end the run.
    for arguments in [&watch[..], &images] {
        let outcome = run(desk.folder.path(), arguments);
        outcome.failed_after_notes(1, &["views: 1 of 2 frames refused"]);
        let said = "refused: views/right/0001.pgm: cannot read the image";
        assert!(outcome.stderr.contains(said), "{}", outcome.stderr);
        assert_eq!(outcome.stdout.lines().count(), 2, "{}", outcome.stdout);
        assert!(
            outcome.stdout.contains("  used, sigma "),
            "{}",
            outcome.stdout
        );
    }
    // An unreadable first one ends it, because the others are measured against it.
    let first = fs::read(desk.path("views/right/0000.pgm")).expect("it was drawn");
    desk.write("views/right/0000.pgm", "P5\n320 240\n255\ntoo short");
    for arguments in [&watch[..], &images] {
        run(desk.folder.path(), arguments).failed_after_notes(1, &["views/right/0000.pgm"]);
    }
    fs::write(desk.path("views/right/0000.pgm"), first).expect("ours");

    // A frame set that lacks an image is followed with the others and a warning, in a growing
    // folder as in a complete one.
    fs::remove_file(desk.path("views/right/0001.pgm")).expect("ours");
    let outcomes = [&watch[..], &images].map(|arguments| run(desk.folder.path(), arguments));
    for outcome in &outcomes {
        assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
        let said = "warning: camera right gave no image; measured without it";
        assert!(outcome.stderr.contains(said), "{}", outcome.stderr);
        let rows: Vec<&str> = outcome.stdout.lines().skip(1).collect();
        assert_eq!(rows.len(), 2, "{rows:?}");
        assert!(rows[0].contains("used, without right, sigma "), "{rows:?}");
        assert!(rows[1].contains("used, sigma "), "{rows:?}");
    }
    assert_eq!(outcomes[0].stdout, outcomes[1].stdout);

    // A frame set with a single image is skipped.
    fs::remove_file(desk.path("views/left/0001.pgm")).expect("ours");
    let outcome = run(desk.folder.path(), &watch);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
    let said = "left/0001.pgm: never came";
    assert!(outcome.stderr.contains(said), "{}", outcome.stderr);
    assert_eq!(outcome.stdout.lines().count(), 2, "{}", outcome.stdout);

    fs::create_dir(desk.path("empty")).expect("ours");
    let empty = [
        "track", "--watch", "empty", "--rig", "rig.toml", "--idle", "0.2",
    ];
    run(desk.folder.path(), &empty).failed_after_notes(1, &["empty", "at least two"]);
    let nowhere = ["track", "--watch", "nowhere", "--rig", "rig.toml"];
    run(desk.folder.path(), &nowhere).failed(1, &["nowhere", "no such folder"]);
    let idle = [
        "track", "--images", "views", "--rig", "rig.toml", "--idle", "1",
    ];
    assert_eq!(run(desk.folder.path(), &idle).code, Some(2));
    let port = [
        "track", "--watch", "views", "--rig", "rig.toml", "--port", "x",
    ];
    run(desk.folder.path(), &port).failed(2, &["--port"]);
}

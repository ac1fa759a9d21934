//! Mistakes that people make: each is named with its way out.

use std::fs;

use super::folder::{AT_REST, desk_with_views};
use super::{Desk, run};
use trinocular_tests::binary::Outcome;

/// Displacements of a target that stays where it was.
const STILL: [Option<[f64; 3]>; 3] = [AT_REST; 3];

fn exchange(desk: &Desk, a: &str, b: &str) {
    let path = |name: &str| desk.path("views").join(name);
    fs::rename(path(a), path("away")).expect("ours");
    fs::rename(path(b), path(a)).expect("ours");
    fs::rename(path("away"), path(b)).expect("ours");
}

#[test]
fn exchanged_folders_are_named() {
    for (a, b) in [("left", "right"), ("middle", "left")] {
        let desk = desk_with_views(&STILL);
        exchange(&desk, a, b);
        for command in [
            &["estimate", "views", "--rig", "rig.toml"][..],
            &["track", "--images", "views", "--rig", "rig.toml"],
            &["align", "views", "--rig", "rig.toml"],
        ] {
            let outcome = run(desk.folder.path(), command);
            assert_eq!(outcome.code, Some(1), "{command:?}: {}", outcome.stderr);
            let said = format!("{}{}", outcome.stdout, outcome.stderr);
            let named = [format!("`{a}` and `{b}`"), format!("`{b}` and `{a}`")];
            let is_named = named.iter().any(|pair| said.contains(pair));
            assert!(is_named && said.contains("exchange them"), "{said}");
        }
    }
}

#[test]
fn exchanged_folders_are_named_by_calibrate() {
    let desk = Desk::new();
    let boards = super::root().join("tests/images/chessboard");
    for (from, to) in [("left", "right"), ("right", "left")] {
        let from = boards.join(from);
        fs::create_dir_all(desk.path("boards").join(to)).expect("ours");
        for file in fs::read_dir(from).expect("the photographs") {
            let file = file.expect("a file");
            let to = desk.path("boards").join(to).join(file.file_name());
            fs::copy(file.path(), to).expect("ours");
        }
    }
    let calibrate = ["calibrate", "boards", "--board", "9x6", "--square", "25"];
    let outcome = run(desk.folder.path(), &[&calibrate[..], &["--json"]].concat());
    let rig = outcome.good_json().pop().expect("the rig");
    let warnings = rig["rig"]["warnings"].to_string();
    let said = "`left` is 83.2 mm to the right of `right`";
    assert!(warnings.contains(said), "{warnings}");
    assert!(outcome.stderr.contains(said), "{}", outcome.stderr);
}

#[test]
fn other_file_endings_are_named() {
    let desk = desk_with_views(&STILL);
    let right = desk.path("views/right");
    for file in fs::read_dir(&right).expect("ours") {
        let path = file.expect("ours").path();
        fs::rename(&path, path.with_extension("pnm")).expect("ours");
    }
    let outcome = run(
        desk.folder.path(),
        &["estimate", "views", "--rig", "rig.toml"],
    );
    outcome.failed(1, &["`left` end in .pgm", "`right` in .pnm", "convert"]);
}

#[test]
fn other_csv_dialects_are_named() {
    let desk = Desk::new();
    let text = desk.read("points.csv");
    let commas = text.replace(',', ";").replace('.', ",");
    for (changed, parts) in [
        (
            text.replace(',', ";"),
            &["points.csv:1", "semicolons", "save the file"],
        ),
        (commas, &["points.csv:1", "semicolons", "decimal points"]),
        (
            text.replace(',', "\t"),
            &["points.csv:1", "tabs", "save the file"],
        ),
        (
            text.replace('.', ","),
            &["points.csv:2", "decimal commas", "193.2"],
        ),
    ] {
        desk.write("points.csv", changed);
        desk.estimate(&[]).failed(1, parts);
    }
    let (header, rows) = text.split_once('\n').expect("rows");
    let (first, rest) = rows.split_once('\n').expect("rows");
    let fields: Vec<String> = first.split(',').map(str::to_owned).collect();
    let quoted = format!("\"{}\"", fields[2].replace('.', ","));
    let row = first.replacen(&fields[2], &quoted, 1);
    desk.write("points.csv", format!("{header}\n{row}\n{rest}"));
    desk.estimate(&[]).failed(
        1,
        &["points.csv:2: field `x0`", "decimal comma", "decimal point"],
    );
}

#[test]
fn utf16_files_are_named() {
    let desk = Desk::new();
    let utf16 = |name: &str, mark: &str| {
        let text = format!("{mark}{}", desk.read(name));
        let bytes: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        desk.write(&format!("wide-{name}"), bytes);
    };
    for mark in ["\u{feff}", ""] {
        utf16("points.csv", mark);
        utf16("rig.toml", mark);
        let way_out = ["UTF-16", "save the file anew with the encoding UTF-8"];
        let files = ["estimate", "wide-points.csv", "--rig", "rig.toml"];
        let points = run(desk.folder.path(), &files);
        points.failed(1, &[&["wide-points.csv:1"], &way_out[..]].concat());
        let rig = run(desk.folder.path(), &["verify", "wide-rig.toml"]);
        rig.failed(1, &[&["wide-rig.toml:1"], &way_out[..]].concat());
    }
    // A byte order mark alone is no mistake.
    for name in ["points.csv", "rig.toml"] {
        desk.write(name, format!("\u{feff}{}", desk.read(name)));
    }
    assert_eq!(desk.estimate(&[]).code, Some(0));
}

#[test]
fn missing_comma_gets_a_hint() {
    let desk = Desk::new();
    let verify = ["verify", "rig.toml", "--points", "25", "50"];
    let outcome = run(desk.folder.path(), &verify);
    assert_eq!(outcome.code, Some(2));
    assert!(
        outcome.stderr.contains("--points 25,50"),
        "{}",
        outcome.stderr
    );
}

#[track_caller]
fn refused_dash(outcome: &Outcome) {
    outcome.failed(1, &["-: ", "standard output", "`./-`"]);
}

#[test]
fn dash_is_refused_as_output() {
    let desk = desk_with_views(&STILL);
    for command in [
        &["verify", "rig.toml", "--report", "-"][..],
        &["tables", "--report", "-"],
        &["align", "views", "--rig", "rig.toml", "--out", "-"],
        &["convert", "rig.toml", "--out", "-"],
        &["convert", "rig.toml", "--ros", "-"],
        &["man", "-"],
        &["--report", "-"],
    ] {
        refused_dash(&run(desk.folder.path(), command));
    }
    assert!(!desk.path("-").exists());
    run(desk.folder.path(), &["verify", "-"]).failed(1, &["-: ", "/dev/stdin"]);
}

#[test]
fn wrong_point_is_named_with_line_and_camera() {
    let desk = Desk::new();
    let text = desk.read("points.csv");
    // The sixth line is the point with id 1 in the camera in the middle.
    let row = text.lines().nth(5).expect("a row");
    let (start, y1) = row.rsplit_once(',').expect("columns");
    let y1: f64 = y1.parse().expect("a number");
    desk.write(
        "points.csv",
        text.replace(row, &format!("{start},{}", y1 + 9.0)),
    );
    let outcome = desk.estimate(&["--json"]);
    let line = &outcome.good_json()[0];
    let said = line["warnings"][0].as_str().expect("a warning");
    assert!(
        said.starts_with("points.csv:6: field `y1`: camera `middle`"),
        "{said}"
    );
    assert!(said.contains("9.0"), "{said}");
    assert!(outcome.stderr.contains(said), "{}", outcome.stderr);
    assert_eq!(line["warnings"].as_array().map(Vec::len), Some(1));
}

#[test]
fn replaced_rig_keeps_comments() {
    let desk = Desk::new();
    desk.write(
        "old.toml",
        format!("# our bench\n{}", desk.read("rig.toml")),
    );
    desk.change("rig.toml", "533.16", "544.5");
    let convert = ["convert", "rig.toml", "--out", "old.toml", "--force"];
    assert_eq!(run(desk.folder.path(), &convert).code, Some(0));
    let kept = desk.read("old.toml");
    assert!(
        kept.starts_with("# our bench\n") && kept.contains("544.5"),
        "{kept}"
    );
    desk.write("old.toml", kept.replace("\"left\"", "\"west\""));
    let outcome = run(desk.folder.path(), &convert);
    let said = "its comments are dropped";
    assert!(outcome.stderr.contains(said), "{}", outcome.stderr);
    assert!(!desk.read("old.toml").contains('#'));
}

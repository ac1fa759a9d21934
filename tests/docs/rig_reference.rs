//! The reference of the rig file against the parser: the complete file is accepted, every field is
//! listed, and the stated defaults and ranges are the program's.

use super::page::Page;
use super::range::{Range, filled, out_of_range};
use super::table::{code, rows};
use std::collections::BTreeSet;
use std::fs;
use trinocular_tests::binary::{Outcome, trinocular};

const PAGE: &str = "docs/rig-file.md";

/// Runs a command on a text in a file; `{}` in `arguments` is the file.
pub fn judged(text: &str, arguments: &[&str]) -> Outcome {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("file.toml");
    fs::write(&path, text).expect("the file can be written");
    let path = path.to_str().expect("a plain path");
    let arguments = arguments
        .iter()
        .map(|argument| argument.replace("{}", path));
    Outcome::of(trinocular().args(arguments))
}

/// Returns the only TOML block of a page.
pub fn complete_file(page: &Page) -> String {
    let blocks = page.blocks();
    let mut toml = blocks.iter().filter(|block| block.language == "toml");
    let block = toml.next().expect("a complete file");
    assert!(toml.next().is_none(), "{}: two TOML blocks", page.name);
    block.lines.join("\n") + "\n"
}

/// Returns the fields of a section that the parser names when it meets an unknown one.
#[track_caller]
pub fn known(error: &str) -> BTreeSet<String> {
    let (_, list) = error
        .split_once("known here: ")
        .unwrap_or_else(|| panic!("{error}"));
    list.trim().split(", ").map(String::from).collect()
}

/// Returns the fields in the first column of a section's tables.
pub fn documented(section: &Page) -> BTreeSet<String> {
    let names = rows(section)
        .into_iter()
        .filter_map(|row| code(row.cells[0]).map(String::from));
    names.collect()
}

fn accepted(text: &str) -> Outcome {
    judged(text, &["convert", "{}"])
}

/// Returns the complete file with one line put after the first line that begins with `after`.
fn with_line(after: &str, line: &str) -> String {
    let text = complete_file(&Page::read(PAGE));
    let begin = format!("\n{after}");
    let at = text.find(&begin).map_or(0, |at| at + 1);
    let end = at + text[at..].find('\n').expect("a line") + 1;
    format!("{}{line}\n{}", &text[..end], &text[end..])
}

/// Returns the complete file without the lines of a field, and with `line` in its section.
fn replaced(field: &str, line: &str) -> String {
    let text = complete_file(&Page::read(PAGE));
    let value: toml_edit::DocumentMut = text.parse().expect("TOML");
    let mut document = value;
    let item: toml_edit::DocumentMut = line.parse().expect("TOML");
    let new = item[field].clone();
    if document["stage"].get(field).is_some() || !CAMERA.contains(&field) {
        document["stage"][field] = new;
    } else {
        document["camera"][0][field] = new;
    }
    document.to_string()
}

const CAMERA: [&str; 19] = [
    "name",
    "focal_px",
    "principal_px",
    "offset_mm",
    "distortion",
    "rotation_deg",
    "device",
    "delay_ms",
    "exposure_us",
    "gain",
    "pixel_format",
    "trigger_mode",
    "trigger_source",
    "trigger_activation",
    "packet_size_bytes",
    "packet_delay_us",
    "packet_resend",
    "bandwidth_mb_s",
    "ptp",
];

#[test]
fn complete_rig_file_is_accepted() {
    let text = complete_file(&Page::read(PAGE));
    let outcome = judged(&text, &["verify", "{}"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.stderr);
}

#[test]
fn complete_rig_file_has_all_fields() {
    let text = complete_file(&Page::read(PAGE));
    let page = Page::read(PAGE);
    for title in ["File", "Cameras", "Stage", "Triggers", "Laser", "Targets"] {
        for field in documented(&page.section(title)) {
            let assigned = text.contains(&format!("\n{field} = "));
            let table = text.contains(&format!("[{field}]"));
            let first = text.starts_with(&field);
            assert!(
                assigned || table || first,
                "{field} is not in the complete file"
            );
        }
    }
}

#[test]
fn rig_reference_lists_every_field() {
    let page = Page::read(PAGE);
    for (title, after) in [
        ("File", "image_size_px"),
        ("Cameras", "[[camera]]"),
        ("Stage", "[stage]"),
        ("Triggers", "[trigger]"),
        ("Laser", "[laser]"),
        ("Targets", "[[target]]"),
    ] {
        let outcome = accepted(&with_line(after, "no_such_field = 1"));
        assert_eq!(outcome.code, Some(1), "{title}");
        let known = known(&outcome.stderr);
        assert_eq!(documented(&page.section(title)), known, "{title}");
    }
}

#[test]
fn rig_reference_states_defaults() {
    let page = Page::read(PAGE);
    let minimal = fs::read_to_string(super::page::root().join("examples/data/rig.toml"));
    let minimal = minimal.expect("the example");
    let expected = accepted(&minimal);
    assert_eq!(expected.code, Some(0), "{}", expected.stderr);
    let mut checked = 0;
    for row in rows(&page.section("Stage")) {
        let field = code(row.cells[0]).expect("a field");
        let Some(default) = row.cells[3].strip_prefix('`') else {
            continue;
        };
        let line = format!("{field} = {}\n", default.trim_end_matches('`'));
        // The rig file is written without fields that stand at their defaults.
        let outcome = accepted(&format!("{minimal}\n{line}"));
        assert_eq!(outcome.code, Some(0), "{line}{}", outcome.stderr);
        assert_eq!(outcome.stdout, expected.stdout, "{line}");
        checked += 1;
    }
    assert!(checked >= 8, "{checked} defaults");
}

#[test]
fn rig_reference_states_ranges() {
    let page = Page::read(PAGE);
    let mut checked = 0;
    for title in ["Cameras", "Stage"] {
        for row in rows(&page.section(title)) {
            let field = code(row.cells[0]).expect("a field");
            let example = code(row.cells[1]).unwrap_or_default();
            let Some(range) = Range::read(row.cells[2]) else {
                continue;
            };
            for (value, good) in range.probes() {
                // The length of the rotation is bounded as well as its parts.
                let value = match field == "rotation_deg" && good {
                    true => value / 2.0,
                    false => value,
                };
                let text = replaced(field, &format!("{field} = {}\n", filled(example, value)));
                let outcome = accepted(&text);
                assert_eq!(
                    !out_of_range(&outcome, field),
                    good,
                    "{field} = {value}: {}",
                    outcome.stderr
                );
            }
            checked += 1;
        }
    }
    assert!(checked >= 19, "{checked} ranges");
}

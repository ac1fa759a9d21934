//! The reference of the scenario file against the parser: the complete file runs, and every field
//! of every kind is listed.

use super::page::Page;
use super::rig_reference::{complete_file, documented, judged, known};
use super::table::{code, rows};
use std::collections::BTreeSet;

const PAGE: &str = "docs/scenario-file.md";
const UNKNOWN: &str = "no_such_field = 1\n";
const CAMERAS: &str = "[cameras]\nkind = \"points\"\nframes_per_s = 60\nlatency_ms = 20\n\
    depth_mm = 850\npoints = 200\nnoise_px = 0.01\n";
const HEAD: &str = "title = \"t\"\nseed = 1\n";
const TARGET: &str = "[[target]]\nmotion = \"still\"\nseconds = 1\n";
const EXPECT: &str = "[expect]\n";

/// Fields that the parser knows in the section of the unknown one.
#[track_caller]
fn fields(text: &str) -> BTreeSet<String> {
    let outcome = judged(text, &["simulate", "{}", "--points"]);
    assert_eq!(outcome.code, Some(1), "{text}\n{}", outcome.stdout);
    known(&outcome.stderr)
}

/// Names of the kinds of a field, from the table of the section that lists them.
fn kinds(section: &str, field: &str) -> Vec<String> {
    let page = Page::read(PAGE).section(section);
    let all = rows(&page);
    let row = all.iter().find(|row| code(row.cells[0]) == Some(field));
    let cell = row.unwrap_or_else(|| panic!("{section}: no {field}")).cells[2];
    cell.split(", ").map(String::from).collect()
}

#[test]
fn complete_scenario_file_runs() {
    let text = complete_file(&Page::read(PAGE));
    let outcome = judged(&text, &["simulate", "{}", "--points"]);
    assert_eq!(
        outcome.code,
        Some(0),
        "{}{}",
        outcome.stdout,
        outcome.stderr
    );
}

#[test]
fn scenario_reference_lists_every_section() {
    let page = Page::read(PAGE);
    let section = |title: &str| documented(&page.section(title));
    let file = fields(&format!("{HEAD}{UNKNOWN}{CAMERAS}{TARGET}{EXPECT}"));
    assert_eq!(section("File"), file);
    let measure = format!("{HEAD}{CAMERAS}{TARGET}[measure]\n{UNKNOWN}{EXPECT}");
    assert_eq!(section("Measure"), fields(&measure));
    let expect = fields(&format!("{HEAD}{CAMERAS}{TARGET}{EXPECT}{UNKNOWN}"));
    assert_eq!(section("Expect"), expect);
    let at = format!("{HEAD}{CAMERAS}{TARGET}{EXPECT}[[expect.at]]\ntime_s = 0.5\n{UNKNOWN}");
    assert_eq!(section("Instants"), fields(&at));
}

#[test]
fn scenario_reference_lists_every_camera_field() {
    let mut all = BTreeSet::new();
    for kind in kinds("Cameras", "kind") {
        let cameras = CAMERAS.replace("points\"", &format!("{kind}\""));
        all.extend(fields(&format!("{HEAD}{cameras}{UNKNOWN}{TARGET}{EXPECT}")));
    }
    assert_eq!(documented(&Page::read(PAGE).section("Cameras")), all);
}

#[test]
fn scenario_reference_lists_every_motion() {
    let mut all = BTreeSet::new();
    for kind in kinds("Target", "motion") {
        let target = TARGET.replace("still", &kind);
        all.extend(fields(&format!("{HEAD}{CAMERAS}{target}{UNKNOWN}{EXPECT}")));
    }
    assert_eq!(documented(&Page::read(PAGE).section("Target")), all);
    let target = TARGET.replace("still", "no_such_motion");
    let known = fields(&format!("{HEAD}{CAMERAS}{target}{EXPECT}"));
    assert_eq!(known, kinds("Target", "motion").into_iter().collect());
}

#[test]
fn scenario_reference_lists_every_event() {
    let event =
        |kind: &str| format!("{HEAD}{CAMERAS}{TARGET}[[event]]\nat_s = 0.5\nwhat = \"{kind}\"\n");
    let page = Page::read(PAGE).section("Events");
    let (mut all, mut named) = (BTreeSet::new(), BTreeSet::new());
    let events = fields(&format!("{}{EXPECT}", event("no_such_event")));
    for row in rows(&page) {
        let name = code(row.cells[0]).expect("a field or an event");
        if row.cells.len() != 3 {
            continue;
        }
        assert!(events.contains(name), "{name} is no event");
        named.insert(name.to_owned());
        let known = fields(&format!("{}{UNKNOWN}{EXPECT}", event(name)));
        let stated = row.cells[1].split(", ").filter_map(code).map(String::from);
        let mut stated: BTreeSet<String> = stated.collect();
        stated.extend(["what", "at_s"].map(String::from));
        assert_eq!(stated, known, "{name}");
        all.extend(known);
    }
    assert_eq!(named, events);
    let fields = rows(&page).into_iter().filter(|row| row.cells.len() == 5);
    let fields: BTreeSet<String> = fields
        .filter_map(|row| code(row.cells[0]).map(String::from))
        .collect();
    assert_eq!(fields, all);
}

//! The reference of the scenario file against the parser: the complete file runs, and every field
//! of every kind is listed.

use super::page::Page;
use super::range::{Range, filled, out_of_range};
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

/// Returns the fields that the parser knows in the section of the unknown one.
#[track_caller]
fn fields(text: &str) -> BTreeSet<String> {
    let outcome = judged(text, &["simulate", "{}", "--points"]);
    assert_eq!(outcome.code, Some(1), "{text}\n{}", outcome.stdout);
    known(&outcome.stderr)
}

/// Returns the names of the kinds of a field, from the table of the section that lists them.
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
fn scenario_reference_lists_sections() {
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
fn scenario_reference_lists_camera_fields() {
    let mut all = BTreeSet::new();
    for kind in kinds("Cameras", "kind") {
        let cameras = CAMERAS.replace("points\"", &format!("{kind}\""));
        all.extend(fields(&format!("{HEAD}{cameras}{UNKNOWN}{TARGET}{EXPECT}")));
    }
    assert_eq!(documented(&Page::read(PAGE).section("Cameras")), all);
}

#[test]
fn scenario_reference_lists_motions() {
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
fn scenario_reference_lists_events() {
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

/// Tables that hold every field with a range, with the titles of their sections.
const TABLES: [(&str, &str); 11] = [
    ("File", HEAD),
    ("Cameras", CAMERAS),
    (
        "Cameras",
        "[cameras]\nkind = \"rendered\"\nframes_per_s = 60\nlatency_ms = 20\ndepth_mm = 850\n\
         noise_grey = 2\n",
    ),
    ("Target", TARGET),
    (
        "Target",
        "[[target]]\nmotion = \"lissajous\"\nseconds = 1\namplitude_mm = [1, 1, 1]\n\
         ratio = [1, 1, 1]\npeak_mm_s = 1\n",
    ),
    (
        "Events",
        "[[event]]\nat_s = 0.5\nwhat = \"silence\"\nseconds = 0.1\n",
    ),
    (
        "Events",
        "[[event]]\nat_s = 0.5\nwhat = \"drop\"\nframes = 1\n",
    ),
    (
        "Events",
        "[[event]]\nat_s = 0.5\nwhat = \"late\"\nframes = 1\nby_ms = 1\n",
    ),
    ("Measure", "[measure]\nsettle_within_mm = [1, 1, 1]\n"),
    (
        "Expect",
        "[expect]\nrms_mm = [1, 1, 1]\nmax_mm = [1, 1, 1]\nlag_mm = 1\nsettle_ms = 1\n\
         overshoot = 1\njitter_mm = [1, 1, 1]\nreversals_per_s = 1\nlatency_ms = 1\n\
         prediction_gain = 1\n",
    ),
    (
        "Instants",
        "[[expect.at]]\ntime_s = 0.5\nerror_mm = [1, 1, 1]\n",
    ),
];

/// Makes every scenario of the ranges end with an error, so that none is run.
const UNMET: &str = "[[expect.at]]\ntime_s = 9999\n";

/// Returns a scenario with this table in the place of the usual one, if there is one.
fn scenario(title: &str, table: &str) -> String {
    let usual = [("File", HEAD), ("Cameras", CAMERAS), ("Target", TARGET)];
    let mut text = String::new();
    for (of, default) in usual {
        text += if of == title { table } else { default };
    }
    match title {
        "Expect" => text + table + UNMET,
        "Instants" => text + EXPECT + table + UNMET,
        "Events" | "Measure" => text + table + EXPECT + UNMET,
        _ => text + EXPECT + UNMET,
    }
}

#[test]
fn scenario_reference_states_ranges() {
    let page = Page::read(PAGE);
    let titles: BTreeSet<&str> = TABLES.iter().map(|(title, _)| *title).collect();
    let mut checked = 0;
    for title in titles {
        for row in rows(&page.section(title)) {
            let Some(range) = row.cells.get(2).and_then(|cell| Range::read(cell)) else {
                continue;
            };
            let field = code(row.cells[0]).expect("a field");
            let example = code(row.cells[1]).expect("an example");
            let begin = format!("\n{field} = ");
            let mut tables = TABLES.iter().filter(|(of, _)| *of == title);
            let (_, table) = tables
                .find(|(_, table)| table.contains(&begin))
                .unwrap_or_else(|| panic!("{title}: {field} is in no table of this test"));
            let (before, rest) = table.split_once(&begin).expect("just found");
            let (_, after) = rest.split_once('\n').expect("a line");
            for (value, good) in range.probes() {
                let table = format!("{before}{begin}{}\n{after}", filled(example, value));
                let outcome = judged(&scenario(title, &table), &["simulate", "{}", "--points"]);
                assert_eq!(outcome.code, Some(1), "{title}: {table}");
                let refused = out_of_range(&outcome, field);
                assert_eq!(refused, !good, "{field} = {value}: {}", outcome.stderr);
            }
            checked += 1;
        }
    }
    assert!(checked >= 20, "{checked} ranges");
}

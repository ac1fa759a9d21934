//! SAFETY.md names tests and laws as evidence; each of them must exist.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Returns the repository's root.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Collects all Rust sources of a folder.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    let entries = std::fs::read_dir(folder).expect("a folder of the repository");
    for entry in entries.map(|entry| entry.expect("an entry").path()) {
        let name = entry
            .file_name()
            .and_then(|name| name.to_str())
            .unwrap_or_default();
        if entry.is_dir() {
            if name != "target" && !name.starts_with('.') {
                sources(&entry, found);
            }
        } else if name.ends_with(".rs") {
            found.push(entry);
        }
    }
}

/// Returns the names of functions that are marked as tests.
fn tests() -> BTreeSet<String> {
    let mut files = Vec::new();
    for folder in ["shared", "host", "firmware", "tests"] {
        sources(&root().join(folder), &mut files);
    }
    let mut names = BTreeSet::new();
    for file in files {
        let text = std::fs::read_to_string(&file).expect("a source");
        let mut marked = false;
        for line in text.lines().map(str::trim) {
            marked |= line == "#[test]";
            let Some(name) = line.strip_prefix("fn ") else {
                continue;
            };
            if std::mem::take(&mut marked) {
                names.extend(name.split('(').next().map(String::from));
            }
        }
    }
    names
}

/// Returns the last cell of each row of the table of hazards.
fn evidence() -> Vec<String> {
    let page = std::fs::read_to_string(root().join("SAFETY.md")).expect("SAFETY.md");
    let (_, hazards) = page.split_once("## Hazards").expect("a section of hazards");
    let rows = hazards
        .lines()
        .filter(|line| line.starts_with("| "))
        .skip(1);
    let cells = rows.map(|row| row.trim_end_matches('|').rsplit('|').next());
    cells
        .map(|cell| cell.expect("a cell").to_string())
        .collect()
}

#[test]
fn every_test_named_in_safety_exists() {
    let tests = tests();
    let laws = std::fs::read_to_string(root().join("tests/FAULTS-INJECTED.md"))
        .expect("tests/FAULTS-INJECTED.md");
    let rows = evidence();
    assert!(rows.len() > 10, "{} hazards", rows.len());
    for row in rows {
        let (tested, lawful) = row.split_once(" law").unwrap_or((&row, ""));
        let names = |text: &str| -> Vec<String> {
            text.split('`')
                .skip(1)
                .step_by(2)
                .map(String::from)
                .collect()
        };
        let (tested, lawful) = (names(tested), names(lawful));
        assert!(!tested.is_empty(), "no test for:{row}");
        for name in tested {
            assert!(
                tests.contains(&name),
                "SAFETY.md names {name}, which is no test"
            );
        }
        for name in lawful {
            let row = format!("| `{name}` |");
            assert!(
                laws.contains(&row),
                "SAFETY.md names the law {name}, which is none"
            );
        }
    }
}

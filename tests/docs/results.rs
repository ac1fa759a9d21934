//! The figures of `RESULTS.md`: each is printed by its command, stands in its table, or is asserted
//! by a test that exists.

use super::page::{Page, root};
use super::table::{Row, numbers, rows};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use trinocular_tests::binary::{Outcome, trinocular};

/// Longest cell, in characters.
const CELL: usize = 80;

/// Evidence that a row names.
enum Evidence<'a> {
    /// A command of the program.
    Command(&'a str),
    /// A test: the file or crate, and its name.
    Test(&'a str, &'a str),
    /// A committed file.
    Table(&'a str),
}

fn evidence<'a>(row: &Row<'a>) -> Evidence<'a> {
    let cell = *row.cells.last().expect("a cell");
    let code: Vec<&str> = cell.split('`').collect();
    match code[..] {
        ["", command, ""] if command.starts_with("trinocular") => Evidence::Command(command),
        ["", file, ": ", name, ""] => Evidence::Test(file, name),
        _ => {
            let path = cell
                .split_once("](")
                .and_then(|(_, rest)| rest.split_once(')'));
            let (path, _) = path.unwrap_or_else(|| panic!("RESULTS.md:{}: no evidence", row.line));
            Evidence::Table(path)
        }
    }
}

/// Returns the numbers of a text without their signs.
fn sizes(text: &str) -> Vec<f64> {
    numbers(text).into_iter().map(f64::abs).collect()
}

/// Runs a command of the page in the root of the repository and returns its output without standard
/// error.
fn run(command: &str) -> Outcome {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["tests", "examples"] {
        std::os::unix::fs::symlink(root().join(name), folder.path().join(name)).expect("a link");
    }
    let words = command.split_whitespace().skip(1);
    Outcome::of(trinocular().args(words).current_dir(folder.path()))
}

/// Returns the Rust files in a folder and below, and the file of the same name.
fn sources(path: &Path) -> Vec<PathBuf> {
    let mut all = vec![path.with_extension("rs")];
    if let Ok(entries) = fs::read_dir(path) {
        for entry in entries {
            let path = entry.expect("an entry").path();
            match path.is_dir() {
                true => all.extend(sources(&path)),
                false => all.push(path),
            }
        }
    }
    all
}

fn test_exists(file: &str, name: &str) -> bool {
    let path = match file {
        "host" | "shared" => root().join(file).join("src"),
        "vision" => root().join("host/vision/src"),
        "board" => root().join("tests/board/tests"),
        file => root().join("tests").join(file),
    };
    let wanted = format!("fn {name}(");
    let read = |path: &PathBuf| fs::read_to_string(path).unwrap_or_default();
    sources(&path)
        .iter()
        .any(|path| read(path).contains(&wanted))
}

#[test]
fn results_have_short_cells() {
    let page = Page::read("RESULTS.md");
    for row in rows(&page) {
        for cell in row.cells {
            assert!(
                cell.chars().count() <= CELL,
                "RESULTS.md:{}: {cell}",
                row.line
            );
        }
    }
}

#[test]
fn readme_has_figures_of_results() {
    let all = sizes(&Page::read("RESULTS.md").text);
    let five = Page::read("README.md").section("Five results");
    let figures: Vec<f64> = rows(&five)
        .iter()
        .flat_map(|row| sizes(row.cells[1]))
        .collect();
    assert!(figures.len() >= 8, "{figures:?}");
    for figure in figures {
        assert!(all.contains(&figure), "README.md: {figure}");
    }
}

#[test]
fn results_name_tests_that_exist() {
    let page = Page::read("RESULTS.md");
    let mut named = 0;
    for row in rows(&page) {
        if let Evidence::Test(file, name) = evidence(&row) {
            assert!(
                test_exists(file, name),
                "RESULTS.md:{}: {file}: {name}",
                row.line
            );
            named += 1;
        }
    }
    assert!(named >= 15, "{named}");
}

#[test]
fn results_are_in_named_tables() {
    let page = Page::read("RESULTS.md");
    let mut compared = 0;
    for row in rows(&page) {
        let Evidence::Table(path) = evidence(&row) else {
            continue;
        };
        let text = fs::read_to_string(root().join(path));
        let text = text.unwrap_or_else(|error| panic!("{path}: {error}"));
        let there = sizes(&text);
        for cell in &row.cells[1..row.cells.len() - 1] {
            for number in sizes(cell) {
                assert!(there.contains(&number), "RESULTS.md:{}: {number}", row.line);
                compared += 1;
            }
        }
    }
    assert!(compared >= 15, "{compared}");
}

#[test]
fn results_are_what_commands_print() {
    let page = Page::read("RESULTS.md");
    let mut outputs: BTreeMap<&str, Outcome> = BTreeMap::new();
    let mut compared = 0;
    let all = rows(&page);
    for row in &all {
        let Evidence::Command(command) = evidence(row) else {
            continue;
        };
        // Computed by `results_of_tables_are_as_stated`.
        if command == "trinocular tables" {
            continue;
        }
        let outcome = outputs.entry(command).or_insert_with(|| run(command));
        let here = row.cells[1];
        if here == "refused" {
            assert_eq!(outcome.code, Some(1), "RESULTS.md:{}", row.line);
            continue;
        }
        assert_eq!(outcome.code, Some(0), "{command}: {}", outcome.stderr);
        let there = sizes(&outcome.stdout);
        for number in sizes(here) {
            assert!(there.contains(&number), "RESULTS.md:{}: {number}", row.line);
            compared += 1;
        }
    }
    assert!(compared >= 10, "{compared}");
}

fn vector(value: &Value) -> [f64; 3] {
    std::array::from_fn(|axis| value[axis].as_f64().expect("a number"))
}

/// Returns the largest difference of two columns of a table, per axis.
fn largest(table: &Value, one: &str, other: &str) -> [f64; 3] {
    let mut most = [0.0f64; 3];
    for row in table.as_array().expect("rows") {
        let (a, b) = (vector(&row[one]), vector(&row[other]));
        most = std::array::from_fn(|axis| most[axis].max((a[axis] - b[axis]).abs()));
    }
    most
}

fn rounded(values: [f64; 3]) -> Vec<f64> {
    values
        .iter()
        .map(|value| (value * 1e4).round() / 1e4)
        .collect()
}

#[test]
fn results_of_tables_are_as_stated() {
    let page = Page::read("RESULTS.md").section("The paper's tables");
    let all = rows(&page);
    let stated = |begin: &str| {
        let row = all.iter().find(|row| row.cells[0].starts_with(begin));
        let row = row.unwrap_or_else(|| panic!("no row `{begin}`"));
        [numbers(row.cells[1]), numbers(row.cells[2])]
    };
    let outcome = run("trinocular tables --json");
    let tables: Value = serde_json::from_str(&outcome.stdout).expect("one JSON object");

    let [here, paper] = stated("Table 5");
    assert_eq!(
        here,
        rounded(largest(&tables["table5"], "midpoint", "true"))
    );
    assert_eq!(paper, rounded(largest(&tables["table5"], "paper", "true")));

    let both = ["table1", "table2"].map(|name| &tables[name]);
    let worst = |one: &str, other: &str| {
        let each = both.map(|table| largest(table, one, other).into_iter().fold(0.0, f64::max));
        each[0].max(each[1])
    };
    let [here, paper] = stated("Tables 1, 2: midpoint");
    let rows_of = both
        .iter()
        .flat_map(|table| table.as_array().expect("rows"));
    for row in rows_of {
        let error = vector(&row["midpoint_worst_error"]);
        assert!(error.iter().all(|error| *error < here[0]), "{row}");
    }
    assert_eq!(paper, rounded([worst("paper", "true"); 3])[..1]);
    let [here, _] = stated("Tables 1, 2: closed form");
    assert_eq!(here, rounded([worst("closed_form", "paper"); 3])[..1]);

    let mut midpoint = [f64::INFINITY, 0.0];
    let mut closed = [f64::INFINITY, 0.0];
    for row in tables["cramer_rao"]["rows"].as_array().expect("rows") {
        let bound = vector(&row["bound_mm"]);
        let over =
            |method: usize, axis: usize| vector(&row["error_mm"][method])[axis] / bound[axis];
        for axis in 0..3 {
            midpoint = [
                midpoint[0].min(over(2, axis)),
                midpoint[1].max(over(2, axis)),
            ];
        }
        closed = [closed[0].min(over(0, 2)), closed[1].max(over(0, 2))];
    }
    let hundredths = |range: [f64; 2]| range.map(|value| (value * 100.0).round() / 100.0).to_vec();
    assert_eq!(stated("error over")[0], hundredths(midpoint));
    assert_eq!(stated("the same, closed form")[0], hundredths(closed));
}

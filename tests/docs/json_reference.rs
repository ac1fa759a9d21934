//! `docs/json.md`: every command with `--json` is run, and the page names every key that it prints.
//!
//! A section per command holds a `sh` block, some of whose commands print JSON, a `json` block with
//! an example, and a table of keys. Keys that several commands share are in the section of common
//! keys.

use super::commands::Desk;
use super::page::{Block, Page};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use tempfile::TempDir;
use trinocular_tests::binary::trinocular;

const PAGE: &str = "docs/json.md";
const COMMON: &str = "Common keys";

/// Commands without `--json`: their output is a file of another format, they serve other programs,
/// or they only group others.
const WITHOUT: [&str; 7] = [
    "bench",
    "completions",
    "export",
    "init",
    "man",
    "serve",
    "twin",
];

/// Returns all commands of the program, which has one manual page for each.
fn commands() -> BTreeSet<String> {
    let folder: TempDir = tempfile::tempdir().expect("a folder");
    let made = trinocular().arg("man").arg(folder.path()).output();
    assert!(made.expect("trinocular runs").status.success());
    let pages = std::fs::read_dir(folder.path()).expect("the pages");
    let names = pages.map(|page| page.expect("a page").file_name());
    let names = names.map(|name| name.into_string().expect("a plain name"));
    // trinocular-bench-flow.1, calibrate-stage's hyphen being part of its name.
    names
        .map(|name| name.trim_end_matches(".1").replacen('-', " ", 1))
        .map(|name| name.replace("bench-", "bench "))
        .filter(|name| {
            !WITHOUT
                .iter()
                .any(|each| name == &format!("trinocular {each}"))
        })
        .collect()
}

/// Adds the paths of all keys of `value` to `paths`: `rig.cameras[].name`.
fn collect(value: &Value, path: &str, paths: &mut BTreeSet<String>) {
    match value {
        Value::Array(items) => {
            for item in items {
                collect(item, &format!("{path}[]"), paths);
            }
        }
        Value::Object(keys) => {
            for (key, inner) in keys {
                let path = format!("{path}.{key}");
                collect(inner, &path, paths);
                paths.insert(path);
            }
        }
        _ => {}
    }
}

fn keys(documents: &[Value]) -> BTreeSet<String> {
    let mut paths = BTreeSet::new();
    for document in documents {
        collect(document, "", &mut paths);
    }
    paths
}

/// Returns the JSON documents in the text, one per line or over several lines.
fn documents(text: &str) -> Result<Vec<Value>, serde_json::Error> {
    serde_json::Deserializer::from_str(text)
        .into_iter()
        .collect()
}

/// Returns true if the page has a table row for the last part of this path.
fn is_named(page: &Page, path: &str) -> bool {
    let key = path
        .rsplit('.')
        .next()
        .unwrap_or(path)
        .trim_end_matches("[]");
    let cell = format!("`{key}`");
    let rows = page.text.lines().filter(|line| line.starts_with("| `"));
    rows.filter_map(|row| row.split('|').nth(1))
        .any(|names| names.split(", ").any(|name| name.trim() == cell))
}

/// Runs the commands of a section; returns what differs from the page.
fn wrong(desk: &mut Desk, section: &Page, common: &Page, blocks: &[Block<'_>]) -> String {
    let of = |language: &str| {
        let mut found = blocks.iter().filter(|block| block.language == language);
        let block = found.next();
        block.unwrap_or_else(|| panic!("{}: no `{language}` block", section.name))
    };
    let (script, mut output, mut wrong) = (of("sh").lines.join("\n"), String::new(), String::new());
    for command in script.replace("\\\n", " ").lines() {
        let (text, code) = desk.run(command);
        if code != 0 {
            return format!("$ {command}\nexit code {code}\n{text}");
        }
        if command.contains(" --json") {
            output += &text;
        }
    }
    // Messages for people go to standard error, which the desk joins.
    let lines = output.lines().filter(|line| line.starts_with('{'));
    let lines: Vec<&str> = lines.collect();
    let printed = match documents(&lines.join("\n")) {
        Ok(printed) => printed,
        Err(error) => return format!("{error}: {output}"),
    };
    if printed.len() != lines.len() {
        let _ = writeln!(wrong, "not one document per line: {output}");
    }
    for document in &printed {
        if document["version"] != 1 {
            let _ = writeln!(wrong, "no version: {document}");
        }
    }
    let printed = keys(&printed);
    for path in &printed {
        if !is_named(section, path) && !is_named(common, path) {
            let _ = writeln!(wrong, "the page has no row for `{path}`");
        }
    }
    match documents(&of("json").lines.join("\n")) {
        Ok(example) => {
            for path in keys(&example).difference(&printed) {
                let _ = writeln!(wrong, "the example has `{path}`, which is not printed");
            }
        }
        Err(error) => wrong += &format!("the example is not JSON: {error}\n"),
    }
    if !wrong.is_empty() {
        let _ = writeln!(wrong, "printed: {output}");
    }
    wrong
}

/// Sections are run in the order of the page, because a station remembers what came before.
#[test]
fn json_page_matches_every_command() {
    let page = Page::read(PAGE);
    let common = page.section(COMMON);
    let titles = page.prose().into_iter().filter_map(|(_, line)| {
        let title = line.strip_prefix("### `")?.strip_suffix('`')?;
        Some(title.to_owned())
    });
    let titles: Vec<String> = titles.collect();
    let documented: BTreeSet<String> = titles.iter().cloned().collect();
    let missing: Vec<String> = commands().difference(&documented).cloned().collect();
    assert!(missing.is_empty(), "{PAGE} has no section for {missing:?}");
    let (mut desk, mut report) = (Desk::new(), String::new());
    for title in titles {
        let section = page.section(&format!("`{title}`"));
        let wrong = wrong(&mut desk, &section, &common, &section.blocks());
        if !wrong.is_empty() {
            let _ = writeln!(report, "{title}:\n{wrong}");
        }
    }
    assert!(report.is_empty(), "not as {PAGE} shows:\n{report}");
}

#[test]
fn key_paths_reach_into_arrays() {
    let document = serde_json::json!({"a": [{"b": 1}, {"c": [2]}], "d": null});
    let expected = [".a", ".a[].b", ".a[].c", ".d"].map(String::from);
    assert_eq!(keys(&[document]), BTreeSet::from(expected));
}

//! Modules that can be used alone depend on no other module of the crate than those listed here.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Collects the modules `m` in every `crate::m` of a file or folder.
fn dependencies(path: &Path, found: &mut BTreeSet<String>) {
    if path.is_dir() {
        for entry in fs::read_dir(path).unwrap() {
            dependencies(&entry.unwrap().path(), found);
        }
        return;
    }
    for part in fs::read_to_string(path).unwrap().split("crate::").skip(1) {
        let end = part.find(|c: char| !c.is_ascii_alphanumeric() && c != '_');
        found.insert(part[..end.unwrap_or(part.len())].to_owned());
    }
}

fn assert_alone(modules: &[&str], needs: &[&str]) {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut found = BTreeSet::new();
    for module in modules {
        dependencies(&source.join(module), &mut found);
    }
    let allowed: BTreeSet<String> = modules
        .iter()
        .chain(needs)
        .map(|m| (*m).to_owned())
        .collect();
    let others: Vec<&String> = found.difference(&allowed).collect();
    assert!(others.is_empty(), "{modules:?} depend on {others:?}");
}

#[test]
fn motion_and_steps_stand_alone() {
    assert_alone(&["motion", "steps"], &["fixed", "time"]);
}

#[test]
fn sums_and_estimate_stand_alone() {
    assert_alone(&["sums", "estimate"], &["fixed", "rig"]);
    assert_alone(&["rig"], &["estimate", "sums"]);
}

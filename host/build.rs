//! The commit that the program is built from, for `trinocular --version`.

use std::path::Path;
use std::process::Command;

/// File that cargo adds to every package.
const PACKAGED: &str = "Cargo.toml.orig";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // A package may lie in a repository of its user's, whose commits are not those of the program.
    let manifest = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    if Path::new(&manifest).join(PACKAGED).exists() {
        return;
    }
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        let text = text.trim().to_owned();
        (output.status.success() && !text.is_empty()).then_some(text)
    };
    // A copy of the sources has no repository.
    let Some(commit) = git(&["rev-parse", "--short=10", "HEAD"]) else {
        return;
    };
    let folder = git(&["rev-parse", "--absolute-git-dir"]).unwrap_or_default();
    // A file that does not exist would have the program built anew each time.
    for file in ["logs/HEAD", "HEAD"].map(|file| format!("{folder}/{file}")) {
        if Path::new(&file).exists() {
            println!("cargo::rerun-if-changed={file}");
        }
    }
    println!("cargo::rustc-env=TRINOCULAR_COMMIT={commit}");
}

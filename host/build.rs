//! The commit that the program is built from, for `trinocular --version`.

use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        let text = text.trim().to_owned();
        (output.status.success() && !text.is_empty()).then_some(text)
    };
    // A package from a registry has no repository.
    let Some(commit) = git(&["rev-parse", "--short=10", "HEAD"]) else {
        return;
    };
    let folder = git(&["rev-parse", "--absolute-git-dir"]).unwrap_or_default();
    // A file that does not exist would have the program built anew each time.
    for file in ["logs/HEAD", "HEAD"].map(|file| format!("{folder}/{file}")) {
        if std::path::Path::new(&file).exists() {
            println!("cargo::rerun-if-changed={file}");
        }
    }
    println!("cargo::rustc-env=TRINOCULAR_COMMIT={commit}");
}

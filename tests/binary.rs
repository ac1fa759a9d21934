//! The program `trinocular`, built for the tests that run it.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

/// A command that runs the current `trinocular`.
pub fn trinocular() -> Command {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    Command::new(PROGRAM.get_or_init(build))
}

/// Builds the program in the profile and target folder of the running test.
///
/// Cargo tells a test where a binary is only within the binary's own package, and a binary found lying in the target
/// folder may be an old one. So Cargo is asked to bring it up to date, which takes a fraction of a second if it is.
fn build() -> PathBuf {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or(env!("CARGO").into()));
    cargo
        // What the test itself needed has been fetched, and the program needs no more.
        .args(["build", "--offline", "--bin", "trinocular"])
        .arg("--message-format=json-render-diagnostics")
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .stderr(Stdio::inherit());
    // target / [triple /] profile / deps / this test
    let test = std::env::current_exe().expect("the running test is a file");
    let profile_folder = test.ancestors().nth(2).expect("in a profile's folder");
    let profile = profile_folder.file_name().and_then(|name| name.to_str());
    match profile.expect("a profile's name") {
        "debug" => &mut cargo,
        other => cargo.args(["--profile", other]),
    };
    if let Some(target_folder) = target_folder(profile_folder) {
        cargo.arg("--target-dir").arg(target_folder);
    }
    let built = cargo.output().expect("cargo runs");
    assert!(built.status.success(), "cargo build of trinocular failed");
    let messages = String::from_utf8(built.stdout).expect("cargo writes UTF-8");
    messages
        .lines()
        .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok())
        .filter_map(|message| message["executable"].as_str().map(PathBuf::from))
        .next_back()
        .expect("cargo names the executable it built")
}

/// The target folder above a profile's folder: the one Cargo has marked as a cache.
fn target_folder(profile_folder: &Path) -> Option<&Path> {
    let mut above = profile_folder.ancestors().skip(1).take(2);
    above.find(|folder| folder.join("CACHEDIR.TAG").is_file())
}

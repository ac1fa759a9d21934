//! The program `trinocular`, built for the tests that run it.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// Returns a command that runs the current `trinocular`.
pub fn trinocular() -> Command {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    Command::new(PROGRAM.get_or_init(build))
}

/// Sends Ctrl-C (SIGINT) to a running program.
pub fn interrupt(program: &Child) {
    signal(program, "INT");
}

/// Sends the signal of this name, written without `SIG`, to a running program.
pub fn signal(program: &Child, name: &str) {
    let mut kill = Command::new("kill");
    let sent = kill
        .args([&format!("-{name}"), &program.id().to_string()])
        .status();
    assert!(sent.expect("kill runs").success());
}

/// Suspends a running program (SIGSTOP), and waits until all its threads stand: on a busy computer
/// some run on for a while.
pub fn suspend(program: &Child) {
    signal(program, "STOP");
    let threads = PathBuf::from(format!("/proc/{}/task", program.id()));
    let stands = |thread: std::io::Result<std::fs::DirEntry>| {
        let about = thread.and_then(|thread| std::fs::read_to_string(thread.path().join("stat")));
        // The state follows the name, which stands in parentheses. A thread may have ended.
        about.map_or(true, |about| {
            let state = about.rsplit_once(')').map(|(_, rest)| rest.trim_start());
            state.is_some_and(|state| state.starts_with('T'))
        })
    };
    let end = Instant::now() + Duration::from_secs(60);
    while !std::fs::read_dir(&threads).is_ok_and(|mut threads| threads.all(stands)) {
        assert!(Instant::now() < end, "the program is not suspended");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Exit code and output of a finished run.
#[derive(Debug)]
pub struct Outcome {
    /// Exit code; `None` after a signal.
    pub code: Option<i32>,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

impl Outcome {
    /// Runs `command` to its end.
    pub fn of(command: &mut Command) -> Self {
        let output = command.output().expect("the program starts");
        let text = |bytes| String::from_utf8(bytes).expect("the program writes UTF-8");
        Self {
            code: output.status.code(),
            stdout: text(output.stdout),
            stderr: text(output.stderr),
        }
    }

    /// Parses every line of standard output as JSON.
    #[track_caller]
    pub fn json(&self) -> Vec<serde_json::Value> {
        let lines = self.stdout.lines();
        lines
            .map(|line| serde_json::from_str(line).expect("each line is one JSON value"))
            .collect()
    }

    /// Parses every line of standard output as JSON after checking that the run succeeded.
    #[track_caller]
    pub fn good_json(&self) -> Vec<serde_json::Value> {
        assert_eq!(self.code, Some(0), "{}", self.stderr);
        self.json()
    }

    /// Checks that the run ended with `code` and printed nothing but one error line that contains
    /// all of `parts`.
    #[track_caller]
    pub fn failed(&self, code: i32, parts: &[&str]) {
        assert_eq!(self.code, Some(code), "{}", self.stderr);
        assert_eq!(self.stdout, "");
        self.complained(parts);
    }

    /// Checks that standard error is one line that contains all of `parts`.
    #[track_caller]
    pub fn complained(&self, parts: &[&str]) {
        let text = &self.stderr;
        assert!(text.starts_with("error: "), "{text}");
        assert_eq!(text.lines().count(), 1, "{text}");
        self.complained_among_others(parts);
    }

    /// Checks that the run ended with `code` and an error line that contains all of `parts`.
    #[track_caller]
    pub fn failed_after_notes(&self, code: i32, parts: &[&str]) {
        assert_eq!(self.code, Some(code), "{}", self.stderr);
        self.complained_among_others(parts);
    }

    #[track_caller]
    fn complained_among_others(&self, parts: &[&str]) {
        let errors = self.stderr.lines().find(|line| line.starts_with("error: "));
        let line = errors.unwrap_or_default();
        for part in parts {
            assert!(line.contains(part), "`{part}` is not in: {}", self.stderr);
        }
    }
}

/// Builds the package in this folder, a workspace of its own, and returns the path of its C
/// library.
pub fn c_library(package: &str) -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join(package);
    let manifest = manifest.join("Cargo.toml");
    let messages = cargo_build(|cargo| cargo.arg("--manifest-path").arg(&manifest));
    messages
        .iter()
        .filter(|message| message["target"]["kind"][0] == "cdylib")
        .filter_map(|message| message["filenames"][0].as_str().map(PathBuf::from))
        .next_back()
        .expect("cargo names the library it built")
}

fn build() -> PathBuf {
    let messages = cargo_build(|cargo| {
        // Building the test has already fetched all dependencies.
        cargo.args(["--offline", "--bin", "trinocular"]);
        if cfg!(feature = "camera") {
            cargo.args(["--features", "trinocular/camera"]);
        }
        if cfg!(feature = "genicam") {
            cargo.args(["--features", "trinocular/genicam"]);
        }
        if cfg!(feature = "gstreamer") {
            cargo.args(["--features", "trinocular/gstreamer"]);
        }
        if cfg!(feature = "foxglove") {
            cargo.args(["--features", "trinocular/foxglove"]);
        }
        cargo
    });
    messages
        .iter()
        .filter_map(|message| message["executable"].as_str().map(PathBuf::from))
        .next_back()
        .expect("cargo names the executable it built")
}

/// Builds the targets that `choose` adds to the command, in the profile and target folder of the
/// running test, and returns Cargo's messages.
///
/// Cargo passes a binary's path only to tests of the binary's own package, and a binary already in
/// the target folder may be out of date. Cargo therefore brings it up to date, which takes a
/// fraction of a second if nothing changed.
fn cargo_build(choose: impl Fn(&mut Command) -> &mut Command) -> Vec<serde_json::Value> {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or(env!("CARGO").into()));
    cargo
        .args(["build", "--locked"])
        .arg("--message-format=json-render-diagnostics")
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."))
        .stderr(Stdio::inherit());
    choose(&mut cargo);
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
    assert!(built.status.success(), "{cargo:?} failed");
    let messages = String::from_utf8(built.stdout).expect("cargo writes UTF-8");
    let lines = messages.lines();
    lines
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect()
}

/// Returns the target folder above a profile's folder: the one that Cargo has marked as a cache.
fn target_folder(profile_folder: &Path) -> Option<&Path> {
    let mut above = profile_folder.ancestors().skip(1).take(2);
    above.find(|folder| folder.join("CACHEDIR.TAG").is_file())
}

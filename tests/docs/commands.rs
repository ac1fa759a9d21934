//! Commands of the pages, run as typed.
//!
//! In a `console` block a line that begins with `$ ` is a command, continued after a backslash on a
//! line that begins with `> `; what follows must be its output, standard error included. A line
//! `...` stands for any lines, ` ...` at the end of a line for its rest. A command must end with
//! exit code 0 unless `$ echo $?` follows.
//!
//! Commands run in a folder that has the repository's `examples`, `tests` and `docs`, with the
//! built program in the path. `/dev/ttyACM0` is the station of `far_end` on a pseudo-terminal; its
//! heartbeat timeout is raised because a test must not fail on a busy computer. A command that ends
//! with ` &` runs until the end of the page; the page shows its first line. `trinocular twin &` gets
//! a link of its own, so that several tests can run at once. `sh` blocks are not run; `trinocular`
//! must accept the options in them.

use super::page::{Block, Page, root};
use std::fmt::Write as _;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use tempfile::TempDir;
use trinocular_tests::binary::trinocular;
use trinocular_tests::far_end::{FarEnd, station};

/// Port that the pages name.
const PORT: &str = "/dev/ttyACM0";
/// Commands that send a heartbeat to a station on a port.
const WITH_HEARTBEAT: [&str; 4] = ["jog", "zero", "home", "track"];

/// A command of a page and its expected output.
struct Step<'a> {
    line: usize,
    command: String,
    expected: Vec<&'a str>,
}

fn steps<'a>(block: &Block<'a>) -> Vec<Step<'a>> {
    let mut steps: Vec<Step<'a>> = Vec::new();
    for (index, line) in block.lines.iter().enumerate() {
        if let Some(command) = line.strip_prefix("$ ") {
            steps.push(Step {
                line: block.line + index,
                command: command.to_owned(),
                expected: Vec::new(),
            });
            continue;
        }
        let step = steps.last_mut().expect("a console block begins with `$ `");
        match (step.command.strip_suffix('\\'), line.strip_prefix("> ")) {
            (Some(begun), Some(rest)) => step.command = format!("{begun}{rest}"),
            _ => step.expected.push(line.trim_end()),
        }
    }
    steps
}

/// Returns true if `actual` is what a page shows; `...` stands for anything.
fn matches(expected: &[&str], actual: &[&str]) -> bool {
    let Some((first, rest)) = expected.split_first() else {
        return actual.is_empty();
    };
    if *first == "..." {
        return (0..=actual.len()).any(|skipped| matches(rest, &actual[skipped..]));
    }
    let Some((line, others)) = actual.split_first() else {
        return false;
    };
    let same = match first.strip_suffix(" ...") {
        Some(begin) => line.starts_with(begin),
        None => first == line,
    };
    same && matches(rest, others)
}

/// Returns true for a line of progress, which a terminal overwrites in place.
fn is_progress(line: &str) -> bool {
    line.rsplit_once(": ").is_some_and(|(_, share)| {
        let digits = share.strip_suffix(" %");
        digits.is_some_and(|digits| digits.bytes().all(|byte| byte.is_ascii_digit()))
    })
}

/// A folder like the repository, a station once a command asks for one, and what runs in the
/// background.
pub struct Desk {
    folder: TempDir,
    station: Option<FarEnd>,
    background: Vec<Child>,
}

impl Drop for Desk {
    fn drop(&mut self) {
        for program in &mut self.background {
            // It may have ended by itself.
            let _ = program.kill();
            let _ = program.wait();
        }
    }
}

impl Desk {
    /// Makes the folder.
    pub fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["examples", "tests", "docs"] {
            std::os::unix::fs::symlink(root().join(name), folder.path().join(name))
                .expect("a link to the repository");
        }
        Self {
            folder,
            station: None,
            background: Vec::new(),
        }
    }

    /// Returns the link of the page's simulated station.
    fn link(&self) -> String {
        self.folder.path().join("twin").display().to_string()
    }

    /// Starts a command in the background; returns its first line.
    fn start(&mut self, command: &str) -> String {
        let mut words = command.split_whitespace();
        assert_eq!(words.next(), Some("trinocular"), "{command}");
        let mut program = trinocular();
        program.args(words).current_dir(self.folder.path());
        if command.starts_with("trinocular twin") {
            program.args(["--link", &self.link()]);
        }
        program.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut program = program.spawn().expect("trinocular runs");
        let mut line = String::new();
        let output = program.stdout.as_mut().expect("it is piped");
        BufReader::new(output).read_line(&mut line).expect("UTF-8");
        self.background.push(program);
        line.replace(&self.link(), "twin")
    }

    /// Runs a command line; returns its output and exit code.
    pub fn run(&mut self, command: &str) -> (String, i32) {
        if let Some(command) = command.strip_suffix(" &") {
            return (self.start(command), 0);
        }
        let mut command = command.to_owned();
        let link = self.link();
        if command.contains("--port twin") {
            let verb = command.split_whitespace().nth(1).unwrap_or_default();
            if WITH_HEARTBEAT.contains(&verb) && command.contains("--rig") {
                command += " --heartbeat 5000";
            }
            command = command.replace("--port twin", &format!("--port {link}"));
            command = command.replace("--cameras twin", &format!("--cameras twin:{link}"));
        }
        let mut port = None;
        if command.contains(PORT) {
            let path = self.station.get_or_insert_with(station).path.clone();
            let verb = command.split_whitespace().nth(1).unwrap_or_default();
            if WITH_HEARTBEAT.contains(&verb) {
                command += " --heartbeat 5000";
            }
            command = command.replace(PORT, &path);
            port = Some(path);
        }
        let program = trinocular();
        let folder = Path::new(program.get_program()).parent().expect("a folder");
        let path = std::env::var("PATH").expect("a search path");
        let output = Command::new("sh")
            .args(["-c", &format!("exec 2>&1; {command}")])
            .current_dir(self.folder.path())
            .env("PATH", format!("{}:{path}", folder.display()))
            .output()
            .expect("a shell runs");
        let mut text = String::from_utf8(output.stdout).expect("UTF-8");
        text = text
            .replace(&format!("twin:{link}"), "twin")
            .replace(&link, "twin");
        if let Some(port) = port {
            text = text.replace(&port, PORT);
        }
        (text, output.status.code().expect("no signal"))
    }
}

/// Runs all console blocks of a page, one after the other.
#[track_caller]
fn page_runs_as_typed(name: &str) {
    let page = Page::read(name);
    let (mut desk, mut wrong) = (Desk::new(), String::new());
    let blocks = page.blocks();
    let console = blocks.iter().filter(|block| block.language == "console");
    let all: Vec<Step<'_>> = console.flat_map(steps).collect();
    let mut last = 0;
    for (index, step) in all.iter().enumerate() {
        let asks = |step: &Step<'_>| step.command == "echo $?";
        let (text, code) = match asks(step) {
            true => (last.to_string(), 0),
            false => desk.run(&step.command),
        };
        last = code;
        let lines: Vec<&str> = text.lines().map(str::trim_end).collect();
        let lines: Vec<&str> = lines
            .into_iter()
            .filter(|line| !is_progress(line))
            .collect();
        let judged = code == 0 || all.get(index + 1).is_some_and(asks);
        if !judged || !matches(&step.expected, &lines) {
            let _ = writeln!(
                wrong,
                "{name}:{}: $ {}\nexit code {code}\n{}\n",
                step.line,
                step.command,
                lines.join("\n")
            );
        }
    }
    assert!(!all.is_empty(), "{name} has no console block");
    assert!(wrong.is_empty(), "not as the page shows:\n{wrong}");
}

/// Pages with console blocks, each of which is a test below.
const RUN: [&str; 8] = [
    "docs/quick-start.md",
    "docs/wiring.md",
    "docs/calibration.md",
    "docs/tracking.md",
    "docs/recordings.md",
    "docs/reports.md",
    "docs/troubleshooting.md",
    "docs/scenario-file.md",
];

#[test]
fn quick_start_runs_as_typed() {
    page_runs_as_typed(RUN[0]);
}

#[test]
fn wiring_runs_as_typed() {
    page_runs_as_typed(RUN[1]);
}

#[test]
fn calibration_runs_as_typed() {
    page_runs_as_typed(RUN[2]);
}

#[test]
fn tracking_runs_as_typed() {
    page_runs_as_typed(RUN[3]);
}

#[test]
fn recordings_runs_as_typed() {
    page_runs_as_typed(RUN[4]);
}

#[test]
fn reports_runs_as_typed() {
    page_runs_as_typed(RUN[5]);
}

#[test]
fn troubleshooting_runs_as_typed() {
    page_runs_as_typed(RUN[6]);
}

#[test]
fn scenario_file_runs_as_typed() {
    page_runs_as_typed(RUN[7]);
}

#[test]
fn pages_with_commands_are_run() {
    for page in Page::all() {
        let runs = page
            .blocks()
            .iter()
            .any(|block| block.language == "console");
        assert_eq!(runs, RUN.contains(&page.name.as_str()), "{}", page.name);
    }
}

#[test]
fn commands_not_run_are_accepted() {
    let mut desk = Desk::new();
    for page in Page::all() {
        for block in page.blocks() {
            if block.language != "sh" {
                continue;
            }
            let joined = block.lines.join("\n").replace("\\\n", " ");
            for line in joined
                .lines()
                .filter(|line| line.starts_with("trinocular "))
            {
                let command = line.split('#').next().unwrap_or_default();
                // A variable of the shell stands for a file.
                let command = command.replace(PORT, "p").replace("\"$file\"", "run.mcap");
                let (text, code) = desk.run(&format!("{command} --help"));
                assert_eq!(code, 0, "{}: {line}\n{text}", page.name);
            }
        }
    }
}

#[test]
fn output_matches_with_ellipses_only() {
    assert!(matches(&["a", "..."], &["a", "b", "c"]));
    assert!(matches(&["...", "c 1 ..."], &["a", "c 1 2"]));
    assert!(!matches(&["a"], &["a", "b"]));
    assert!(!matches(&["...", "b"], &["a", "b", "c"]));
    assert!(!matches(&["c 2 ..."], &["c 1 2"]));
}

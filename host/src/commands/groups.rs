//! The list of commands in the help, grouped by purpose.

use std::fmt::Write as _;

use clap::Subcommand as _;

use super::Command;

/// Layout of the help: clap's own, with [`commands`] in place of its list.
pub const TEMPLATE: &str = "\
{about-with-newline}
{usage-heading} {usage}

{before-help}Options:
{options}{after-help}
";

/// Names of the commands by purpose.
const GROUPS: [(&str, &[&str]); 6] = [
    ("Measure", &["estimate", "track", "serve", "reference"]),
    ("Recordings", &["report", "replay", "export"]),
    (
        "Set up",
        &[
            "init",
            "cameras",
            "calibrate",
            "convert",
            "align",
            "verify",
            "calibrate-stage",
            "latency",
        ],
    ),
    (
        "Station",
        &[
            "ports", "hello", "status", "jog", "home", "zero", "stop", "reset", "motors",
            "diagnose",
        ],
    ),
    ("Simulate", &["twin", "simulate", "tables"]),
    ("For developers", &["bench", "completions", "man"]),
];

/// Columns of the first line's indent and of the names.
const NAMES: usize = 19;
/// Columns of a line.
const LINE: usize = 100;

/// Formats the groups, each command with the first line of its help.
pub fn commands() -> String {
    let program = Command::augment_subcommands(clap::Command::new("trinocular"));
    let mut text = String::new();
    for (heading, names) in GROUPS {
        let _ = writeln!(text, "{heading}:");
        for name in names {
            let command = program.find_subcommand(name);
            let about = command.and_then(clap::Command::get_about);
            let about = about.map(ToString::to_string).unwrap_or_default();
            let mut line = format!("  {name:<width$}", width = NAMES - 3);
            for word in about.split_whitespace() {
                if line.chars().count() + 1 + word.chars().count() > LINE {
                    let _ = writeln!(text, "{line}");
                    line = " ".repeat(NAMES - 1);
                }
                line.push(' ');
                line.push_str(word);
            }
            let _ = writeln!(text, "{line}");
        }
        text.push('\n');
    }
    text.push_str("`trinocular help COMMAND` explains a command.\n");
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_is_listed_once() {
        let mut listed: Vec<&str> = GROUPS
            .iter()
            .flat_map(|(_, names)| *names)
            .copied()
            .collect();
        listed.sort_unstable();
        let program = Command::augment_subcommands(clap::Command::new("trinocular"));
        let mut known: Vec<&str> = program.get_subcommands().map(|c| c.get_name()).collect();
        known.sort_unstable();
        assert_eq!(listed, known);
    }

    #[test]
    fn list_explains_each_command_within_its_columns() {
        let text = commands();
        for (_, names) in GROUPS {
            for name in names {
                let lines = text
                    .lines()
                    .filter(|line| line.starts_with(&format!("  {name} ")));
                let about = lines.map(|line| line[NAMES..].len()).sum::<usize>();
                assert!(about > 10, "{name}: {text}");
            }
        }
        assert!(
            text.lines().all(|line| line.chars().count() <= LINE),
            "{text}"
        );
    }
}

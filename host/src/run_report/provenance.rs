//! Origin of a run: date, program, machine, command line, seed and rig.

use crate::report::Page;
use std::collections::BTreeMap;

/// Longest fact, characters; a recording's texts are those of its file.
const LONGEST: usize = 600;
/// Longest rig file on a page, bytes.
const LONGEST_RIG: usize = 200_000;

/// Origin of a run by the names that recordings have for its parts, and its rig file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Provenance {
    /// Texts by name: `program`, `version`, `command` and the like.
    pub origin: BTreeMap<String, String>,
    /// Text of the rig file.
    pub rig: Option<String>,
}

impl Provenance {
    /// Creates the provenance of a run of this program.
    pub fn new<N: Into<String>>(
        origin: impl IntoIterator<Item = (N, String)>,
        rig: Option<String>,
    ) -> Self {
        let origin = origin.into_iter().map(|(name, text)| (name.into(), text));
        let origin = origin.collect();
        Self { origin, rig }
    }

    /// Returns the origin as name and value for the reader.
    pub fn facts(&self) -> Vec<(String, String)> {
        let text = |name: &str| {
            let text = self.origin.get(name)?;
            (!text.is_empty()).then(|| text.chars().take(LONGEST).collect::<String>())
        };
        let begun = text("begun_unix_s").and_then(|seconds| seconds.parse().ok());
        let program = text("program").map(|program| {
            let version = text("version").unwrap_or_default();
            let commit = text("commit").unwrap_or_else(|| "unknown".to_owned());
            format!("{program} {version}, commit {commit}")
        });
        let board = text("twin").map(|board| format!("twin ({board})"));
        let facts = [
            ("date", begun.map(utc)),
            ("command", text("command")),
            ("program", program),
            ("machine", text("machine")),
            ("seed", text("seed")),
            ("station", board.or_else(|| text("station"))),
            ("estimator", text("estimator")),
            (
                "cameras",
                text("cameras").map(|names| names.replace(',', ", ")),
            ),
            ("protocol", text("protocol")),
        ];
        let known = facts
            .into_iter()
            .filter_map(|(name, value)| Some((name.to_owned(), value?)));
        known.collect()
    }

    /// Adds the provenance to a page, as its last section.
    pub fn add_to(&self, page: Page) -> Page {
        let page = page.section("Provenance", "").facts(&self.facts());
        match &self.rig {
            Some(rig) if rig.len() <= LONGEST_RIG => {
                page.text("Rig file", "Cameras and stage of this run (TOML).", rig)
            }
            Some(rig) => page.paragraph(format!("The rig file has {} bytes.", rig.len())),
            None => page,
        }
    }
}

/// Returns an instant as date and time in UTC, by the proleptic Gregorian calendar.
fn utc(unix_s: u64) -> String {
    let (days, second) = (unix_s / 86_400, unix_s % 86_400);
    // Eras of 400 years and years that begin with March, so that the leap day is a year's last.
    let day = days + 719_468;
    let (era, day) = (day / 146_097, day % 146_097);
    let year = (day - day / 1_460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let (month, next) = if month < 10 {
        (month + 3, 0)
    } else {
        (month - 9, 1)
    };
    let year = era * 400 + year + next;
    let (hour, minute, second) = (second / 3_600, second / 60 % 60, second % 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02} UTC")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_follow_the_calendar() {
        for (unix_s, text) in [
            (0, "1970-01-01 00:00:00 UTC"),
            (951_782_399, "2000-02-28 23:59:59 UTC"),
            (951_782_400, "2000-02-29 00:00:00 UTC"),
            (1_795_930_000, "2026-11-29 05:26:40 UTC"),
            (4_107_542_400, "2100-03-01 00:00:00 UTC"),
        ] {
            assert_eq!(utc(unix_s), text);
        }
    }

    #[test]
    fn unknown_parts_are_left_out() {
        let origin = [("seed", "7".to_owned()), ("begun_unix_s", "x".to_owned())];
        let facts = Provenance::new(origin, None).facts();
        assert_eq!(facts, [("seed".to_owned(), "7".to_owned())]);
    }
}

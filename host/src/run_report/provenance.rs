//! Origin of a run: date, program, machine, command line, seed and rig.

use crate::calendar::Utc;
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

/// Returns an instant as date and time in UTC.
fn utc(unix_s: u64) -> String {
    let Utc {
        year,
        month,
        day,
        hour,
        minute,
        second,
    } = Utc::of(unix_s);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02} UTC")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn date_is_written_in_utc() {
        assert_eq!(utc(1_795_930_000), "2026-11-29 05:26:40 UTC");
    }

    #[test]
    fn unknown_parts_are_left_out() {
        let origin = [("seed", "7".to_owned()), ("begun_unix_s", "x".to_owned())];
        let facts = Provenance::new(origin, None).facts();
        assert_eq!(facts, [("seed".to_owned(), "7".to_owned())]);
    }
}

//! Results of a campaign, law by law.

use crate::judge::Counts;
use crate::laws::{Law, Violation};
use crate::life::Fate;
use crate::options::{CampaignOptions, Kind};
use crate::page;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Number of violations kept per law.
const KEPT: usize = 5;

/// Sum of many lives.
pub struct Tally {
    laws: &'static [Law],
    pub lives: u64,
    counts: Counts,
    hits: BTreeMap<Law, (u64, Vec<(u64, Violation)>)>,
}

impl Tally {
    /// Returns an empty tally.
    pub fn new(kind: Kind) -> Self {
        let laws: &[Law] = match kind {
            Kind::Station => &Law::STATION,
            Kind::Loop => &Law::LOOP,
        };
        Self {
            laws,
            lives: 0,
            counts: Counts::default(),
            hits: BTreeMap::new(),
        }
    }

    /// Adds a life and returns the messages about laws that it broke.
    pub fn add(&mut self, seed: u64, fate: Fate) -> Vec<String> {
        self.lives += 1;
        self.counts.add(&fate.counts);
        let mut said = Vec::new();
        for violation in fate.violations {
            let (count, kept) = self.hits.entry(violation.law).or_default();
            *count += 1;
            if *count <= KEPT as u64 {
                said.push(line(seed, &violation));
            }
            kept.push((seed, violation));
            // The result must not depend on the order in which threads finish.
            kept.sort_by_key(|(seed, _)| *seed);
            kept.truncate(KEPT);
        }
        said
    }

    /// Returns the number of violations over all laws, at most one per law and life.
    pub fn violations(&self) -> u64 {
        self.hits.values().map(|(count, _)| count).sum()
    }

    /// Returns the number of violations as [`Tally::violations`], without those of the laws in
    /// `counted`.
    pub fn violations_but(&self, counted: &[String]) -> u64 {
        let deciding = self
            .hits
            .iter()
            .filter(|(law, _)| !counted.iter().any(|name| law.name() == name));
        deciding.map(|(_, (count, _))| count).sum()
    }

    fn hits_of(&self, law: Law) -> u64 {
        self.hits.get(&law).map_or(0, |(count, _)| *count)
    }

    /// Returns the counts with their names, in the order of the tables.
    fn numbers(&self) -> [(&'static str, String); 6] {
        let counts = &self.counts;
        let hours = counts.us as f64 / 3.6e9;
        [
            ("lives", grouped(self.lives)),
            ("hours of the station's time", format!("{hours:.1}")),
            ("commands", grouped(counts.commands)),
            ("STEP edges", grouped(counts.edges)),
            ("reports", grouped(counts.reports)),
            ("comparisons", grouped(counts.comparisons)),
        ]
    }

    /// Formats the tally for a terminal.
    pub fn summary(&self, options: &CampaignOptions) -> String {
        let mut text = String::new();
        for (_, kept) in self.hits.values() {
            for (seed, violation) in kept {
                let kind = options.kind.name();
                let _ = writeln!(text, "{}", line(*seed, violation));
                let _ = writeln!(text, "    campaign --kind {kind} --replay {seed}");
            }
        }
        let first = options.seed;
        let last = first + options.lives - 1;
        let _ = writeln!(
            text,
            "{} lives, seeds {first} to {last}",
            options.kind.name()
        );
        for (name, number) in self.numbers() {
            let _ = writeln!(text, "{number:>16} {name}");
        }
        for law in self
            .laws
            .iter()
            .chain(self.hits.keys().filter(|law| !self.laws.contains(law)))
        {
            let _ = writeln!(text, "{:>16} {}", grouped(self.hits_of(*law)), law.name());
        }
        let _ = writeln!(text, "{} violations", grouped(self.violations()));
        text
    }

    /// Formats the tally for the page; `seconds` is the time that the run took.
    pub fn markdown(&self, options: &CampaignOptions, seconds: u64) -> String {
        let mut text = String::new();
        let first = options.seed;
        let last = first + options.lives - 1;
        let _ = writeln!(text, "\n## {}\n", page::title(options.kind));
        let _ = writeln!(text, "{}\n", page::about(options.kind));
        let _ = writeln!(text, "Seeds {first} to {last}, {} s:\n", grouped(seconds));
        for (name, number) in self.numbers() {
            let _ = writeln!(text, "- {number} {name}");
        }
        let _ = writeln!(
            text,
            "\n| law | what it says | broken by lives |\n|---|---|---:|"
        );
        for law in self.laws {
            let hits = grouped(self.hits_of(*law));
            let _ = writeln!(text, "| `{}` | {} | {hits} |", law.name(), law.text());
        }
        text
    }
}

/// Formats a violation as a line.
fn line(seed: u64, violation: &Violation) -> String {
    let (name, at, what) = (violation.law.name(), violation.at_ms, &violation.text);
    format!("{name}: seed {seed} at {at:.1} ms: {what}")
}

/// Formats a number with a comma after every three digits.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_grouped_by_thousands() {
        let expected = ["0", "999", "1,000", "12,345", "1,000,000"];
        assert_eq!([0, 999, 1_000, 12_345, 1_000_000].map(grouped), expected);
    }
}

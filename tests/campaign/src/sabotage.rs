//! Sabotaged data for the judge.
//!
//! A judge that finds no fault proves nothing, so each law must notice a station that breaks it.
//! This module changes the judge's input as such a station would.

use crate::pins::WIRING;
use trinocular_core::frame::message::{Denial, Outcome, Report};
use trinocular_core::safety::Trust;

/// Kind of sabotage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sabotage {
    /// No sabotage.
    #[default]
    None,
    /// A step of each axis is missing now and then.
    Steps,
    /// DIR changes at the same time as the step.
    LateTurns,
    /// Every DIR level is inverted.
    Backwards,
    /// Each step is made twice.
    Twice,
    /// Motion ends and begins without a ramp: every other tick has no steps.
    Jerks,
    /// Every tenth answer is missing.
    Silence,
    /// Every tenth answer comes twice.
    Echo,
    /// Pings get no answer.
    NoPongs,
    /// Statuses name no fault.
    NoFaults,
    /// Every status states that the position is known.
    Homed,
    /// Every status states that the position is unknown.
    Unknown,
    /// Denied commands are reported as accepted.
    Obeys,
    /// Stale and broken packets get answers.
    Credulous,
}

impl Sabotage {
    /// All kinds of sabotage.
    pub const ALL: [Self; 13] = [
        Self::Steps,
        Self::LateTurns,
        Self::Backwards,
        Self::Twice,
        Self::Jerks,
        Self::Silence,
        Self::Echo,
        Self::NoPongs,
        Self::NoFaults,
        Self::Homed,
        Self::Unknown,
        Self::Obeys,
        Self::Credulous,
    ];

    /// Returns the name on the command line.
    pub fn name(self) -> String {
        format!("{self:?}").to_lowercase()
    }

    /// Changes the words of segment `number`.
    pub fn words(self, number: u64, words: &mut [u32]) {
        let step: u32 = WIRING.step.iter().map(|pin| 1 << pin).sum();
        let dir: u32 = WIRING.dir.iter().map(|pin| 1 << pin).sum();
        match self {
            Self::Steps if number.is_multiple_of(97) => {
                words[0] |= step;
                words[1] |= step << 16;
            }
            Self::LateTurns => {
                for word in words.iter_mut().filter(|word| **word & step != 0) {
                    *word = (*word & !(dir << 16)) | dir | (dir << 16 & *word);
                }
            }
            Self::Backwards => {
                for word in words {
                    let (high, low) = (*word & dir, *word & (dir << 16));
                    *word = (*word & !(dir | dir << 16)) | high << 16 | low >> 16;
                }
            }
            Self::Twice => {
                // Iterate from the end, so that a copy is not copied again.
                for at in (0..words.len() - 2).step_by(2).rev() {
                    if words[at] & step != 0 && words[at + 2] & step == 0 {
                        words[at + 2] |= words[at] & step;
                        words[at + 3] |= (words[at] & step) << 16;
                    }
                }
            }
            Self::Jerks if (number / 4).is_multiple_of(2) => words.fill(0),
            _ => {}
        }
    }

    /// Changes report `number`; `None` withholds it from the judge.
    pub fn report(self, number: u64, mut report: Report) -> Option<Report> {
        match (self, &mut report) {
            (Self::Silence, Report::Answer { .. }) if number.is_multiple_of(10) => return None,
            (Self::NoPongs, Report::Pong { .. }) => return None,
            (Self::NoFaults, Report::Status(status)) => crate::judge::hide_faults(status),
            (Self::Homed, Report::Status(status)) => status.trust = Trust::Homed,
            (Self::Unknown, Report::Status(status)) => status.trust = Trust::Unknown,
            (Self::Obeys, Report::Answer { outcome, .. })
                if !matches!(outcome, Outcome::Denied(Denial::Config(_))) =>
            {
                *outcome = Outcome::Accepted;
            }
            _ => {}
        }
        Some(report)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laws::Law;
    use crate::life::live_with;
    use std::collections::BTreeSet;

    /// Laws that the life itself checks without the judge.
    const OBVIOUS: [Law; 4] = [Law::Panic, Law::Wedge, Law::Segment, Law::Report];

    /// Returns the laws that a life breaks.
    fn broken(seed: u64, sabotage: Sabotage) -> BTreeSet<Law> {
        let violations = live_with(seed, false, sabotage).violations;
        violations.iter().map(|violation| violation.law).collect()
    }

    #[test]
    fn every_law_notices_its_violation() {
        let honest: Vec<_> = (0..80).map(|seed| broken(seed, Sabotage::None)).collect();
        let mut all = BTreeSet::from(OBVIOUS);
        for sabotage in Sabotage::ALL {
            let lives = (0..).zip(&honest);
            let noticed = lives.flat_map(|(seed, honest)| &broken(seed, sabotage) - honest);
            let noticed: BTreeSet<Law> = noticed.collect();
            assert!(!noticed.is_empty(), "{sabotage:?} is not noticed");
            all.extend(noticed);
        }
        let laws = Law::STATION.into_iter();
        let missing: Vec<Law> = laws.filter(|law| !all.contains(law)).collect();
        assert!(missing.is_empty(), "never noticed: {missing:?}");
    }
}

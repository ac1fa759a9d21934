//! Reported triggers, each with bounds of its instant on this computer's clock.
//!
//! The station has a ping after it was sent, and sends a report before it is heard. Both hold with
//! any delay on the line or in this computer, and bound the lead of this computer's clock over the
//! station's from below and from above. If the station's clock stands still, the lead grows: the
//! bound from above is that of this very report, so it has grown, too. If this computer's clock
//! stands still, the lead falls, and a report contradicts the bound from below, which is then
//! forgotten.

use super::span::Span;
use std::collections::VecDeque;
use std::path::PathBuf;
use trinocular_core::frame::message::Triggered;

/// Least time from a trigger to the dispatch of its report, µs.
const SENT_AFTER_US: i64 = Triggered::REPORTED_AFTER_US as i64;

/// Largest difference of two clocks' rates: 1 to this.
const DRIFT: i64 = 5_000;

/// Number of triggers that are kept: a second at the highest rate.
const KEPT: usize = 1_000;

/// Trigger that the station has given.
#[derive(Clone, Copy, Debug)]
pub struct Given {
    pub number: u32,
    /// Instant on the station's clock, µs.
    pub instant_us: i64,
    /// The same on this computer's clock; `None` if it has no bounds.
    pub here: Option<Span>,
    /// False if its report was lost on the line, and the instant is a guess from its neighbours.
    pub is_reported: bool,
}

/// Images of one camera while the time to their stamps is learnt.
#[derive(Debug)]
pub struct Learner {
    pub path: PathBuf,
    pub stamps_us: Vec<i64>,
    /// Time from a trigger to the time stamp of its image.
    pub delay: Option<Span>,
}

#[derive(Debug)]
pub struct Reports {
    pub period_us: i64,
    /// Longest time by which a trigger comes later than at even intervals.
    pub wait_us: i64,
    /// Number of times that the station has begun to count.
    pub starts: u64,
    pub given: VecDeque<Given>,
    /// Number of reports that have come.
    pub heard: u64,
    pub cameras: Vec<Learner>,
    /// Least lead of this computer's clock, and when it was found, µs.
    least: Option<(i64, i64)>,
}

impl Reports {
    pub fn new(period_us: i64) -> Self {
        Self {
            period_us,
            wait_us: 0,
            starts: 0,
            given: VecDeque::new(),
            heard: 0,
            cameras: Vec::new(),
            least: None,
        }
    }

    pub fn attend(&mut self, cameras: Vec<PathBuf>) {
        let learner = |path| Learner {
            path,
            stamps_us: Vec::new(),
            delay: None,
        };
        self.cameras = cameras.into_iter().map(learner).collect();
    }

    pub fn newest(&self) -> Option<&Given> {
        self.given.back()
    }

    pub fn begin(&mut self) {
        self.given.clear();
        for camera in &mut self.cameras {
            camera.stamps_us.clear();
        }
    }

    pub fn pinged(&mut self, sent_us: i64, instant_us: i64) {
        let lead_us = sent_us - instant_us;
        let least_us = self.least_us(sent_us);
        self.least = Some((
            least_us.map_or(lead_us, |least| least.max(lead_us)),
            sent_us,
        ));
    }

    fn least_us(&self, at_us: i64) -> Option<i64> {
        let (least_us, found_us) = self.least?;
        Some(least_us - (at_us - found_us).max(0) / DRIFT)
    }

    pub fn add(&mut self, number: u32, instant_us: i64, heard_us: i64) {
        self.heard += 1;
        let last = self.given.back().copied();
        if last.is_some_and(|last| number <= last.number) {
            // The station counts anew.
            self.given.clear();
        }
        if self.given.is_empty() {
            self.starts += 1;
        }
        let most_us = heard_us - instant_us - SENT_AFTER_US;
        let least_us = self.least_us(heard_us);
        if least_us.is_some_and(|least_us| least_us > most_us) {
            self.least = None;
        }
        let here = least_us.filter(|least_us| *least_us <= most_us);
        let here = here.map(|least_us| Span {
            from_us: instant_us + least_us,
            to_us: instant_us + most_us,
        });
        let given = Given {
            number,
            instant_us,
            here,
            is_reported: true,
        };
        if let Some(last) = self.given.back().copied() {
            self.add_lost(last, given);
        }
        self.given.push_back(given);
        let excess = self.given.len().saturating_sub(KEPT);
        self.given.drain(..excess);
    }

    /// Adds the triggers between two of which the reports were lost on the line: they came at even
    /// intervals, or later by the wait.
    fn add_lost(&mut self, last: Given, next: Given) {
        let gap = i64::from(next.number - last.number);
        let between = |from: i64, to: i64, n: i64| from + (to - from) * n / gap;
        let lost = (gap - KEPT as i64).max(1)..gap;
        let wait_us = self.wait_us;
        self.given.extend(lost.map(|n| Given {
            number: last.number + n as u32,
            instant_us: between(last.instant_us, next.instant_us, n),
            here: last.here.zip(next.here).map(|(from, to)| {
                let even = Span {
                    from_us: between(from.from_us, to.from_us, n),
                    to_us: between(from.to_us, to.to_us, n),
                };
                even.wider(wait_us)
            }),
            is_reported: false,
        }));
    }
}

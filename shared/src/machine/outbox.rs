//! Reports that wait to be sent.
//!
//! The link being slow must never stop motion, so nothing here waits for room. There is room for
//! every answer of a control tick, because the shell sends all that waits before the next one. What
//! finds no room all the same, after a burst of hellos or pings within a tick, is counted.

use super::inbox::{COMMANDS, DROPPED, STOPS};
use crate::frame::message::{Outcome, Report, Status};
use heapless::Deque;

/// The most answers of one control tick.
const ANSWERS: usize = COMMANDS + DROPPED + STOPS;

/// Other reports that may wait: hello, the last run, pongs.
const REPORTS: usize = 8;

/// The answer to one command.
#[derive(Clone, Copy, Debug)]
pub(super) struct Answer {
    pub sequence: u16,
    pub tick: u32,
    pub outcome: Outcome,
}

/// Reports that wait to be sent.
#[derive(Clone, Debug, Default)]
pub(super) struct Outbox {
    reports: Deque<Report, REPORTS>,
    answers: Deque<Answer, ANSWERS>,
    status: Option<Status>,
}

/// A report that found no room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub(super) struct Full;

impl Outbox {
    /// Takes a report that is neither an answer nor a status.
    pub fn report(&mut self, report: Report) -> Result<(), Full> {
        self.reports.push_back(report).map_err(|_| Full)
    }

    /// Takes an answer.
    pub fn answer(&mut self, answer: Answer) -> Result<(), Full> {
        self.answers.push_back(answer).map_err(|_| Full)
    }

    /// Takes a status, which replaces one that was not sent.
    pub fn status(&mut self, status: Status) {
        self.status = Some(status);
    }

    /// The next report to send: what the host asked first, then answers, then the status that
    /// shows what they did.
    pub fn next(&mut self) -> Option<Report> {
        if let Some(report) = self.reports.pop_front() {
            return Some(report);
        }
        if let Some(answer) = self.answers.pop_front() {
            return Some(Report::Answer {
                sequence: answer.sequence,
                tick: answer.tick,
                outcome: answer.outcome,
            });
        }
        self.status.take().map(Report::Status)
    }
}

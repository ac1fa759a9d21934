//! Queue of reports to send.
//!
//! A slow link must never stop motion, so nothing here waits for room. There is room for every
//! answer of a control tick, because the shell sends the whole queue before the next one. After a
//! burst of hellos or pings within a tick, reports without room are counted.

use super::inbox::{COMMANDS, DROPPED, STOPS};
use crate::frame::message::{Outcome, Report, Status, Triggered};
use heapless::Deque;

/// Largest number of answers of one control tick.
const ANSWERS: usize = COMMANDS + DROPPED + STOPS;

/// Largest number of other reports in the queue: hello, the last run, pongs.
const REPORTS: usize = 8;

/// Largest number of triggers in the queue: those of eight control ticks at the highest rate.
const TRIGGERS: usize = 8;

/// Answer to one command.
#[derive(Clone, Copy, Debug)]
pub(super) struct Answer {
    pub sequence: u16,
    pub tick: u32,
    pub outcome: Outcome,
}

/// Queue of reports to send.
#[derive(Clone, Debug, Default)]
pub(super) struct Outbox {
    reports: Deque<Report, REPORTS>,
    answers: Deque<Answer, ANSWERS>,
    triggers: Deque<Triggered, TRIGGERS>,
    status: Option<Status>,
}

/// Error of a report that found no room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub(super) struct Full;

impl Outbox {
    /// Queues a report that is neither an answer nor a status.
    pub fn report(&mut self, report: Report) -> Result<(), Full> {
        self.reports.push_back(report).map_err(|_| Full)
    }

    /// Queues an answer.
    pub fn answer(&mut self, answer: Answer) -> Result<(), Full> {
        self.answers.push_back(answer).map_err(|_| Full)
    }

    /// Queues a trigger.
    pub fn triggered(&mut self, triggered: Triggered) -> Result<(), Full> {
        self.triggers.push_back(triggered).map_err(|_| Full)
    }

    /// Drops the triggers in the queue, because they are counted anew.
    pub fn forget_triggers(&mut self) {
        self.triggers.clear();
    }

    /// Queues a status, which replaces one that was not sent yet.
    pub fn status(&mut self, status: Status) {
        self.status = Some(status);
    }

    /// Takes the next report to send: replies to hello and ping first, then answers, then triggers,
    /// then the status.
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
        if let Some(triggered) = self.triggers.pop_front() {
            return Some(Report::Triggered(triggered));
        }
        self.status.take().map(Report::Status)
    }
}

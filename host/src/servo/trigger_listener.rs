//! Listener on the line to a station that triggers the cameras: takes its reports to the images.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant as HostInstant};
use trinocular_client::observer::StationObserver;
use trinocular_core::frame::message::Report;
use trinocular_core::frame::receive::Receiver;
use trinocular_core::safety::Inputs;
use trinocular_core::steps::Segment;
use trinocular_core::time::Instant;
use trinocular_vision::images::cameras::triggers::Triggers;

/// State of the line.
#[derive(Default)]
struct Line {
    receiver: Receiver<Report>,
    /// Zero of the line's clock, or later by the shortest time between reading both clocks.
    zero: Option<HostInstant>,
}

/// Observer of a line that fills a list of triggers, and passes everything on to another observer.
pub struct TriggerListener {
    triggers: Arc<Triggers>,
    line: Mutex<Line>,
    next: Mutex<Option<Arc<dyn StationObserver>>>,
}

impl std::fmt::Debug for TriggerListener {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TriggerListener").finish_non_exhaustive()
    }
}

impl TriggerListener {
    /// Creates the listener of this list.
    pub fn new(triggers: Arc<Triggers>) -> Self {
        Self {
            triggers,
            line: Mutex::default(),
            next: Mutex::default(),
        }
    }

    /// Sets the observer to which everything is passed on.
    pub fn pass_to(&self, next: Option<Arc<dyn StationObserver>>) {
        *self.next_lock() = next;
    }

    fn next_lock(&self) -> MutexGuard<'_, Option<Arc<dyn StationObserver>>> {
        self.next.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn next(&self) -> Option<Arc<dyn StationObserver>> {
        self.next_lock().clone()
    }
}

impl StationObserver for TriggerListener {
    fn sent(&self, at_us: u64, bytes: &[u8]) {
        if let Some(next) = self.next() {
            next.sent(at_us, bytes);
        }
    }

    fn received(&self, at_us: u64, mut bytes: &[u8]) {
        let heard = HostInstant::now();
        if let Some(next) = self.next() {
            next.received(at_us, bytes);
        }
        let mut line = self.line.lock().unwrap_or_else(PoisonError::into_inner);
        let zero = heard.checked_sub(Duration::from_micros(at_us));
        line.zero = line.zero.into_iter().chain(zero).min();
        while let Some(report) = line.receiver.next(&mut bytes) {
            match (report, line.zero) {
                (Ok(Report::Triggered(given)), _) => {
                    let instant_us = given.instant.micros();
                    self.triggers.report(given.number, instant_us, heard);
                }
                (
                    Ok(Report::Pong {
                        host_us, received, ..
                    }),
                    Some(zero),
                ) => {
                    if let Some(sent) = zero.checked_add(Duration::from_micros(host_us)) {
                        self.triggers.ping(sent, received.micros());
                    }
                }
                _ => {}
            }
        }
    }

    fn segment(&self, at: Instant, segment: &Segment, words: &[u32]) {
        if let Some(next) = self.next() {
            next.segment(at, segment, words);
        }
    }

    fn switches(&self, at: Instant, inputs: &Inputs) {
        if let Some(next) = self.next() {
            next.switches(at, inputs);
        }
    }

    fn line_lost(&self, at_us: u64, reason: &str) {
        if let Some(next) = self.next() {
            next.line_lost(at_us, reason);
        }
    }
}

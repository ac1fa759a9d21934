//! Listener on the line to a station that triggers the cameras: its reports go to the images.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant as HostInstant;
use trinocular_client::observer::StationObserver;
use trinocular_core::frame::message::Report;
use trinocular_core::frame::receive::Receiver;
use trinocular_core::safety::Inputs;
use trinocular_core::steps::Segment;
use trinocular_core::time::Instant;
use trinocular_rig::rig_file::Trigger;
use trinocular_vision::images::cameras::triggers::Triggers;

/// Triggers of a run, and where its images find them.
#[derive(Clone, Debug)]
pub struct Triggering {
    /// Settings of the rig file.
    pub trigger: Trigger,
    /// Triggers that the station has reported. Their instants are the middle of the exposure.
    pub triggers: Arc<Triggers>,
}

impl Triggering {
    /// Creates a list of triggers with these settings.
    pub fn new(trigger: Trigger) -> Self {
        Self {
            trigger,
            triggers: Arc::new(Triggers::new(trigger.rate_hz)),
        }
    }

    /// Returns an observer of the station that fills the list, and passes everything on to `next`.
    pub fn listener(&self, next: Option<Arc<dyn StationObserver>>) -> Arc<dyn StationObserver> {
        Arc::new(TriggerListener {
            triggers: Arc::clone(&self.triggers),
            middle_us: u64::from(self.trigger.exposure_us / 2),
            receiver: Mutex::default(),
            next,
        })
    }
}

struct TriggerListener {
    triggers: Arc<Triggers>,
    /// Time from the trigger to the middle of the exposure, µs.
    middle_us: u64,
    receiver: Mutex<Receiver<Report>>,
    next: Option<Arc<dyn StationObserver>>,
}

impl StationObserver for TriggerListener {
    fn sent(&self, at_us: u64, bytes: &[u8]) {
        if let Some(next) = &self.next {
            next.sent(at_us, bytes);
        }
    }

    fn received(&self, at_us: u64, mut bytes: &[u8]) {
        let heard = HostInstant::now();
        if let Some(next) = &self.next {
            next.received(at_us, bytes);
        }
        let receiver = self.receiver.lock();
        let mut receiver = receiver.unwrap_or_else(PoisonError::into_inner);
        while let Some(report) = receiver.next(&mut bytes) {
            if let Ok(Report::Triggered(given)) = report {
                let middle = given.instant.plus_micros(self.middle_us);
                self.triggers.report(given.number, middle.micros(), heard);
            }
        }
    }

    fn segment(&self, at: Instant, segment: &Segment, words: &[u32]) {
        if let Some(next) = &self.next {
            next.segment(at, segment, words);
        }
    }

    fn switches(&self, at: Instant, inputs: &Inputs) {
        if let Some(next) = &self.next {
            next.switches(at, inputs);
        }
    }

    fn line_lost(&self, at_us: u64, reason: &str) {
        if let Some(next) = &self.next {
            next.line_lost(at_us, reason);
        }
    }
}

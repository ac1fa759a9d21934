//! Triggers of the cameras by the station: their start, and the listener on the line that takes the
//! reports to the images.

use super::ServoError;
use super::station_link::StationLink;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant as HostInstant};
use trinocular_client::observer::StationObserver;
use trinocular_core::frame::message::{Command, Report, Trigger as Settings};
use trinocular_core::frame::receive::Receiver;
use trinocular_core::safety::Inputs;
use trinocular_core::steps::Segment;
use trinocular_core::time::Instant;
use trinocular_rig::rig_file::Trigger;
use trinocular_vision::images::cameras::triggers::{LEAST, Triggers};

/// Highest rate of the triggers from which the delay of the time stamps is learnt: no image of one
/// is still on its way at the next, and the command that ends them comes before the next.
const LEARNING_HZ: u16 = 10;

/// Interval at which the number of triggers is checked, µs.
const LOOK_US: u64 = 2_000;

/// Longest wait for these triggers, µs: at the lowest rate, they come within 2 s.
const PATIENCE_US: u64 = 5_000_000;

/// Time for the images of these triggers to arrive, µs: of the first attempt, doubled with each
/// further one up to the longest.
const SILENCE_US: u64 = 250_000;
const LONGEST_SILENCE_US: u64 = 1_000_000;

/// Largest number of attempts.
const ATTEMPTS: u32 = 8;

/// Triggers of a run, and where its images find them.
#[derive(Clone, Debug)]
pub struct Triggering {
    /// Settings of the rig file.
    pub trigger: Trigger,
    /// Triggers that the station has reported.
    pub triggers: Arc<Triggers>,
}

impl Triggering {
    /// Creates a list of triggers with these settings.
    pub fn new(trigger: Trigger) -> Self {
        Self {
            trigger,
            triggers: Arc::new(Triggers::new(
                trigger.rate_hz,
                u64::from(trigger.exposure_us / 2),
            )),
        }
    }

    /// Learns from a few triggers how late the cameras' time stamps are, and starts the triggers.
    ///
    /// # Errors
    /// If a camera does not give one image of each of these triggers, as often as this is tried;
    /// if the station cannot be reached or has no camera pin.
    pub fn start(&self, station: &mut StationLink) -> Result<(), ServoError> {
        let started = self.learn_and_start(station);
        if started.is_err() {
            // A station that cannot be reached goes on: triggers move nothing.
            let _ = station.command("trigger", Command::Trigger(Settings::OFF));
        }
        started
    }

    fn learn_and_start(&self, station: &mut StationLink) -> Result<(), ServoError> {
        let settings = self.trigger.settings();
        let slow = Settings {
            rate_hz: settings.rate_hz.min(LEARNING_HZ),
            ..settings
        };
        let mut silence_us = SILENCE_US;
        for attempt in 1.. {
            self.triggers.begin();
            station.command("trigger", Command::Trigger(slow))?;
            let end = station.now().plus_micros(PATIENCE_US);
            while self.triggers.given() < LEAST && station.now() < end {
                station.advance(station.now().plus_micros(LOOK_US));
            }
            station.command("trigger", Command::Trigger(Settings::OFF))?;
            station.advance(station.now().plus_micros(silence_us));
            match self.triggers.learn() {
                Ok(()) => break,
                Err(error) if attempt == ATTEMPTS => return Err(error.into()),
                Err(_) => silence_us = (2 * silence_us).min(LONGEST_SILENCE_US),
            }
        }
        self.triggers.begin();
        station.command("trigger", Command::Trigger(settings))?;
        Ok(())
    }

    /// Returns an observer of the station that fills the list, and passes everything on to `next`.
    pub fn listener(&self, next: Option<Arc<dyn StationObserver>>) -> Arc<dyn StationObserver> {
        Arc::new(TriggerListener {
            triggers: Arc::clone(&self.triggers),
            line: Mutex::default(),
            next,
        })
    }
}

/// State of the line.
#[derive(Default)]
struct Line {
    receiver: Receiver<Report>,
    /// Zero of the line's clock, or later by the shortest time between reading both clocks.
    zero: Option<HostInstant>,
}

struct TriggerListener {
    triggers: Arc<Triggers>,
    line: Mutex<Line>,
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

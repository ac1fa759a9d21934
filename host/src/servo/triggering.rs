//! Triggers of the cameras by the station: their start, their watch and their end. The same for all
//! commands with live cameras.

use super::ServoError;
use super::trigger_listener::TriggerListener;
use std::sync::Arc;
use std::task::Poll;
use std::time::{Duration, Instant as HostInstant};
use trinocular_client::StationError;
use trinocular_client::observer::StationObserver;
use trinocular_client::serial::Serial;
use trinocular_core::frame::message::{Command, Trigger as Settings};
use trinocular_rig::notice;
use trinocular_rig::rig_file::Trigger;
use trinocular_vision::images::FrameSet;
use trinocular_vision::images::cameras::live::LiveCameras;
use trinocular_vision::images::cameras::triggers::{LEAST, Triggers};

/// Highest rate of the triggers from which the delay of the time stamps is learnt: no image of one
/// is still on its way at the next, and the command that ends them comes before the next.
const LEARNING_HZ: u16 = 10;

/// Longest wait for these triggers: at the lowest rate, they come within 2 s.
const PATIENCE: Duration = Duration::from_secs(5);

/// Time for the images of these triggers to arrive: of the first attempt, doubled with each further
/// one up to the longest.
const SILENCE: Duration = Duration::from_millis(250);
const LONGEST_SILENCE: Duration = Duration::from_secs(1);

/// Largest number of attempts.
const ATTEMPTS: u32 = 8;

/// Time without a report, beyond two periods, after which the station gives no triggers: more than
/// the longest silence of another program that learns through this one.
const QUIET: Duration = Duration::from_secs(2);

/// Longest time between two looks that counts as quiet. A program that was suspended for longer has
/// waited for no report meanwhile.
const LONGEST_LOOK: Duration = Duration::from_millis(200);

/// Time for the answer to the command that ends the triggers, and the time after which it is
/// repeated.
const END_PATIENCE: Duration = Duration::from_millis(600);
const END_PERIOD: Duration = Duration::from_millis(150);

/// Polling period of that answer.
const LOOK: Duration = Duration::from_millis(1);

/// Triggers of a run, and where its images find them.
#[derive(Clone, Debug)]
pub struct Triggering {
    /// Settings of the rig file.
    pub trigger: Trigger,
    /// Triggers that the station has reported.
    pub triggers: Arc<Triggers>,
    listener: Arc<TriggerListener>,
}

impl Triggering {
    /// Creates a list of triggers with these settings.
    pub fn new(trigger: Trigger) -> Self {
        let middle_us = u64::from(trigger.exposure_us / 2);
        let triggers = Triggers::new(trigger.rate_hz, middle_us);
        let triggers = Arc::new(triggers.with_wait(trigger.settings().longest_wait_us()));
        Self {
            trigger,
            listener: Arc::new(TriggerListener::new(Arc::clone(&triggers))),
            triggers,
        }
    }

    /// Returns the observer of the station that fills the list, and passes everything on to `next`.
    pub fn listener(&self, next: Option<Arc<dyn StationObserver>>) -> Arc<dyn StationObserver> {
        self.listener.pass_to(next);
        Arc::clone(&self.listener) as Arc<dyn StationObserver>
    }

    /// Learns from a few triggers how late the cameras' time stamps are, and starts the triggers.
    /// The [listener](Triggering::listener) must be on the line.
    ///
    /// # Errors
    /// If a camera does not give one image of each of these triggers, as often as this is tried;
    /// if the station cannot be reached or has no camera pin. The triggers are off then.
    pub fn start(&self, serial: &mut Serial) -> Result<(), ServoError> {
        let started = self.learn(serial).and_then(|()| self.give(serial));
        if started.is_err() {
            Self::end(serial);
        }
        started
    }

    fn learn(&self, serial: &mut Serial) -> Result<(), ServoError> {
        let settings = self.trigger.settings();
        let slow = Settings {
            rate_hz: settings.rate_hz.min(LEARNING_HZ),
            ..settings
        };
        let mut silence = SILENCE;
        for attempt in 1.. {
            self.triggers.begin();
            serial.command("trigger", Command::Trigger(slow))?;
            serial.wait_until(HostInstant::now() + PATIENCE, |_| {
                (self.triggers.given() >= LEAST).then_some(())
            })?;
            serial.command("trigger", Command::Trigger(Settings::OFF))?;
            serial.wait_until(HostInstant::now() + silence, |_| None::<()>)?;
            match self.triggers.learn() {
                Ok(()) => break,
                Err(error) if attempt == ATTEMPTS => return Err(error.into()),
                Err(_) => silence = (2 * silence).min(LONGEST_SILENCE),
            }
        }
        Ok(())
    }

    /// Starts the triggers at their rate. The cameras' delays must have been learnt.
    fn give(&self, serial: &mut Serial) -> Result<(), ServoError> {
        self.triggers.begin();
        Ok(serial.command("trigger", Command::Trigger(self.trigger.settings()))?)
    }

    /// Ends the triggers, after the motion of a stage that this program moves. Says so if the station
    /// does not answer: it then goes on.
    pub fn end(serial: &mut Serial) {
        // No wait for the triggers holds up a stop.
        serial.end_motion();
        let off = Command::Trigger(Settings::OFF);
        let end = HostInstant::now() + END_PATIENCE;
        let (mut sent, mut next) = (Vec::new(), HostInstant::now());
        loop {
            let now = HostInstant::now();
            if now >= end {
                break;
            }
            if now >= next {
                sent.push(serial.send(off));
                next = now + END_PERIOD;
            }
            if (sent.iter()).any(|sequence| serial.answer(*sequence) == Some(Ok(()))) {
                return;
            }
            std::thread::sleep(LOOK);
        }
        notice!(
            "warning: the station did not confirm the end of the triggers, so it may go on \
             triggering the cameras, which moves nothing; a restart of the station ends them, and \
             so does the next run with [trigger]"
        );
    }
}

/// Watch of the triggers of a run: starts them again when the station gives none any more, because
/// it has restarted or another program has ended them.
#[derive(Debug)]
pub struct TriggerWatch {
    triggering: Triggering,
    /// Number of reports at the last look.
    heard: u64,
    /// Time for which no report has come.
    quiet: Duration,
    /// Last look; `None` if the line was lost since.
    looked: Option<HostInstant>,
}

impl TriggerWatch {
    /// Watches triggers that were started.
    pub fn new(triggering: Triggering) -> Self {
        Self {
            heard: triggering.triggers.heard(),
            triggering,
            quiet: Duration::ZERO,
            looked: None,
        }
    }

    /// Waits for a lost line, and starts triggers that have ended again. Returns the words for that.
    ///
    /// # Errors
    /// As [`Serial::check`] after a loss of the line; as [`Serial::command`].
    fn look(&mut self, serial: &mut Serial) -> Result<Option<&'static str>, StationError> {
        let line = serial.wait_until(HostInstant::now(), |_| Some(()));
        if let Err(error) = line {
            self.looked = None;
            return Err(error);
        }
        let heard = self.triggering.triggers.heard();
        let now = HostInstant::now();
        let before = self.looked.replace(now);
        if heard != self.heard || before.is_none() {
            self.heard = heard;
            self.quiet = Duration::ZERO;
        }
        let passed = before.map_or(Duration::ZERO, |before| now.duration_since(before));
        self.quiet += passed.min(LONGEST_LOOK);
        let period = Duration::from_secs(1) / u32::from(self.triggering.trigger.rate_hz.max(1));
        if self.quiet < QUIET + 2 * period {
            return Ok(None);
        }
        self.quiet = Duration::ZERO;
        self.triggering.triggers.begin();
        let settings = self.triggering.trigger.settings();
        serial.greet();
        serial.command("trigger", Command::Trigger(settings))?;
        Ok(Some(
            "the station gave no triggers any more, because it has restarted or another program \
             ended them; they were started again",
        ))
    }

    /// Waits for the next images of the triggers; `None` at the end. A lost line does not count as
    /// silence of the cameras. `tell` gets what has happened meanwhile, in words.
    ///
    /// # Errors
    /// As [`Serial::check`] after a loss of the line, and as [`Serial::command`]; if the images do
    /// not come.
    pub fn next_images(
        &mut self,
        serial: &mut Serial,
        cameras: &mut LiveCameras,
        mut tell: impl FnMut(&str),
    ) -> Result<Option<FrameSet>, ServoError> {
        loop {
            if let Some(started) = self.look(serial)? {
                tell(started);
                // The clock of a station that has restarted begins anew.
                cameras.begin_times_anew();
            }
            if let Poll::Ready(images) = cameras.next_within(LONGEST_LOOK / 2) {
                return Ok(images.transpose()?);
            }
        }
    }
}

//! A station, its cameras and the people at its live page: looks at the images all the time, and
//! follows, jogs, zeroes, homes and resets on request.
//!
//! The loop owns the station. Requests wait in a bounded queue that the loop empties between two
//! frame sets; only a stop does not wait: it goes to the station from the thread of the page.
//!
//! While nothing is followed, other runs of the program may drive the station through this one
//! ([`Access::Open`]).

use super::ServoError;
use super::live::LiveObserver;
use super::observer::ServoObserver;
use super::page_recording::PageRecording;
use super::station_link::StationLink;
use super::visual_servo::VisualServo;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant as HostInstant};
use trinocular_client::StationError;
use trinocular_client::diagnosis;
use trinocular_client::serial::{Access, Stopper};
use trinocular_core::frame::message::{Command, Denial, Status};
use trinocular_core::rig::Rig;
use trinocular_core::safety::State;
use trinocular_core::time::Instant;
use trinocular_live::controls::{Action, Offers};
use trinocular_live::{Controls, Hub};
use trinocular_rig::rig_file::Stage;
use trinocular_vision::images::FrameSet;
use trinocular_vision::sums::Estimator;

/// Requests that wait; further ones are refused.
const REQUESTS: usize = 16;

/// Longest time for a stage to come to rest before a reset.
const REST_PATIENCE: Duration = Duration::from_secs(10);

/// Name of the page in messages.
const PAGE: &str = "the live page";

/// Images of one instant.
#[derive(Debug)]
pub struct Shot {
    /// Images of all cameras.
    pub images: FrameSet,
    /// Capture time on the station's clock.
    pub taken: Instant,
}

/// Source of images, and the station that moves the cameras or the target.
pub trait Bench {
    /// Waits for the next images; `None` at the end.
    ///
    /// # Errors
    /// If the station cannot be reached, or the images do not come.
    fn next_shot(&mut self) -> Result<Option<Shot>, ServoError>;

    /// Returns the station.
    fn station(&mut self) -> &mut StationLink;
}

/// Controls of a workbench, for the threads of its pages.
#[derive(Debug)]
pub struct Desk {
    stopper: Option<Stopper>,
    offers: Offers,
    requests: SyncSender<Action>,
}

impl Controls for Desk {
    fn offers(&self) -> Offers {
        self.offers
    }

    fn stop(&self) {
        if let Some(stopper) = &self.stopper {
            stopper.stop(PAGE);
        }
        // The loop notices the stop by itself; a full queue is no reason to fail.
        let _ = self.requests.try_send(Action::Stop {});
    }

    fn request(&self, action: Action) -> Result<(), String> {
        self.requests.try_send(action).map_err(|error| match error {
            TrySendError::Full(_) => "the station is busy; try again".to_owned(),
            TrySendError::Disconnected(_) => "the run has ended".to_owned(),
        })
    }
}

/// Loop that owns the station.
#[derive(Debug)]
pub struct Workbench<B> {
    bench: B,
    rig: Rig,
    stage: Stage,
    estimator: Estimator,
    hub: Arc<Hub>,
    requests: Receiver<Action>,
    servo: Option<VisualServo>,
    /// Deadline of a reset that waits for the stage to stand.
    reset: Option<HostInstant>,
    recording: PageRecording,
    /// Images of the keyframe, while the target is followed.
    keyframe: Option<FrameSet>,
}

impl<B: Bench> Workbench<B> {
    /// Makes the loop and its controls.
    pub fn new(
        mut bench: B,
        rig: &Rig,
        stage: &Stage,
        estimator: Estimator,
        hub: Arc<Hub>,
        recording: PageRecording,
    ) -> (Self, Desk) {
        let (sender, requests) = sync_channel(REQUESTS);
        let stopper = bench.station().serial().map(|serial| serial.stopper());
        let desk = Desk {
            offers: Offers {
                stop: stopper.is_some(),
                motion: true,
                home: stage.care.home.iter().any(Option::is_some),
                record: recording.is_on_request(),
                mark: true,
            },
            stopper,
            requests: sender,
        };
        let mut bench = Self {
            bench,
            rig: rig.clone(),
            stage: stage.clone(),
            estimator,
            hub,
            requests,
            servo: None,
            reset: None,
            recording,
            keyframe: None,
        };
        bench.share();
        (bench, desk)
    }

    /// Lets other runs drive the station.
    fn share(&mut self) {
        if let Some(serial) = self.bench.station().serial_mut() {
            // Only taking it back can fail.
            let _ = serial.set_access(Access::Open);
        }
    }

    /// Starts to follow with the next images, without a request.
    pub fn follow_at_once(&mut self) {
        self.begin();
    }

    /// Runs until `is_over` returns true, the images end or the station is lost. A stage that still
    /// moves stops when the workbench is dropped.
    ///
    /// # Errors
    /// If the station cannot be reached, restarted, or does not stop, or if a recording that a page
    /// started was ended early.
    pub fn run(&mut self, is_over: impl Fn() -> bool) -> Result<(), ServoError> {
        let outcome = self.turn_until(is_over);
        self.servo = None;
        self.recording.end(&self.hub, self.bench.station());
        let recorded = self.recording.wait();
        match outcome {
            Ok(()) | Err(ServoError::Station(StationError::Cancelled)) => Ok(recorded?),
            outcome => outcome,
        }
    }

    fn turn_until(&mut self, is_over: impl Fn() -> bool) -> Result<(), ServoError> {
        while !is_over() {
            while let Ok(action) = self.requests.try_recv() {
                self.act(action)?;
            }
            self.try_reset()?;
            self.recording.check(&self.hub, self.bench.station());
            match self.bench.next_shot() {
                Ok(None) => break,
                Ok(Some(shot)) => self.take(&shot)?,
                Err(ServoError::Station(error)) => self.forgive(error)?,
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Follows the target into the images, or only shows them.
    fn take(&mut self, shot: &Shot) -> Result<(), ServoError> {
        let Some(servo) = &mut self.servo else {
            let station = self.bench.station();
            let (stage_mm, status) = (station.position_mm(), station.status());
            let taken_us = shot.taken.micros();
            self.hub
                .look(taken_us, &shot.images, stage_mm, status.as_ref());
            return Ok(());
        };
        if servo.keyframe_time() == Instant::default() {
            match servo.set_keyframe(&shot.images) {
                Ok(()) => {
                    servo.set_keyframe_time(shot.taken);
                    self.keyframe = Some(shot.images.clone());
                }
                Err(refusal) => {
                    self.hub
                        .warn(format!("these images cannot be the reference: {refusal}"));
                    self.end_following();
                }
            }
            return Ok(());
        }
        let station = self.bench.station();
        match servo.step(station, &shot.images, shot.taken, None) {
            Ok(_) => Ok(()),
            Err(error) => self.forgive(error),
        }
    }

    /// Goes on after an error that leaves the station in reach.
    fn forgive(&mut self, error: StationError) -> Result<(), ServoError> {
        match error {
            StationError::StoppedByOther { by } => {
                // Requests from before the stop must not undo it.
                while self.requests.try_recv().is_ok() {}
                self.end_following();
                self.reset = None;
                // The station itself stays stopped until a reset.
                if let Some(serial) = self.bench.station().serial_mut() {
                    serial.forgive_stop();
                }
                self.hub.warn(format!("stopped by {by}"));
                Ok(())
            }
            StationError::Faulted(fault) => {
                if self.servo.is_some() {
                    let text = diagnosis::fault(fault);
                    let number = fault.number();
                    self.hub.warn(format!("fault {number}: {}", text.cause));
                }
                self.end_following();
                Ok(())
            }
            error @ StationError::Interrupted { .. } => {
                self.end_following();
                self.hub.warn(error.to_string());
                Ok(self.bench.station().resume(error)?)
            }
            error => Err(error.into()),
        }
    }

    fn end_following(&mut self) {
        self.servo = None;
        self.keyframe = None;
        self.share();
        self.hub.set_following(false);
    }

    /// Makes sure that no other run drives the station and that it has this run's configuration;
    /// a warning on the page says why not.
    fn take_over(&mut self) -> bool {
        let Some(serial) = self.bench.station().serial_mut() else {
            return true;
        };
        let taken = serial
            .set_access(Access::Busy)
            .and_then(|()| serial.restore_configuration());
        if let Err(error) = &taken {
            self.hub.warn(error.to_string());
            self.share();
        }
        taken.is_ok()
    }

    fn begin(&mut self) {
        if !self.take_over() {
            return;
        }
        match VisualServo::new(&self.rig, self.estimator) {
            Ok(mut servo) => {
                servo.set_observers(self.observers());
                self.servo = Some(servo);
                self.hub.set_following(true);
            }
            Err(refusal) => {
                self.hub.warn(refusal.to_string());
                self.share();
            }
        }
    }

    /// Makes the observers of the loop: the pages, and the recording if there is one.
    fn observers(&self) -> Vec<Box<dyn ServoObserver>> {
        let mut observers = self.recording.observers(&self.rig);
        observers.push(Box::new(LiveObserver::new(Arc::clone(&self.hub))));
        observers
    }

    /// Starts or ends a recording, and goes on with what is followed.
    fn record(&mut self, on: bool) {
        let station = self.bench.station();
        match on {
            true => {
                let keyframe = self.keyframe.as_ref();
                self.recording
                    .begin(&self.hub, station, (&self.rig, keyframe));
            }
            false => self.recording.end(&self.hub, station),
        }
        let observers = self.observers();
        if let Some(servo) = &mut self.servo {
            servo.set_observers(observers);
        }
    }

    fn act(&mut self, action: Action) -> Result<(), ServoError> {
        match action {
            Action::Stop {} => {
                // A reset from before the stop must not undo it.
                self.reset = None;
                // Stopped already from the thread of the page; this notices it if nothing moves.
                let station = self.bench.station();
                match station.serial().map(|serial| serial.check()) {
                    Some(Err(error)) => self.forgive(error)?,
                    _ => {
                        self.send("stop", Command::Stop)?;
                    }
                }
            }
            Action::Reset {} => self.reset = Some(HostInstant::now() + REST_PATIENCE),
            Action::Follow { on: true } if self.servo.is_some() => {}
            Action::Follow { on: true } => self.begin(),
            Action::Follow { on: false } => {
                if self.servo.is_some() {
                    self.end_following();
                    self.hub.note("following ended");
                    // A stop and a reset: the stage comes to rest instead of running on to its
                    // prediction, and is ready again.
                    self.send("stop", Command::Stop)?;
                    self.reset = Some(HostInstant::now() + REST_PATIENCE);
                }
            }
            Action::Record { on } => self.record(on),
            Action::Mark { text } => {
                self.recording.event("mark", &text);
                self.hub.mark(text);
            }
            Action::Jog { .. } | Action::Zero {} | Action::Home {} if self.servo.is_some() => {
                self.hub.warn("end following first");
            }
            Action::Jog { distance_um } => {
                self.drive("jog", Command::Jog { distance_um })?;
            }
            Action::Zero {} => {
                if self.drive("zero", Command::Zero)? {
                    self.hub.note("zero is here");
                }
            }
            Action::Home {} => {
                let axes = self.stage.care.home.map(|home| home.is_some());
                self.drive("home", Command::Home { axes })?;
            }
        }
        Ok(())
    }

    /// Sends a command that needs the station for this run; returns true if it was accepted.
    fn drive(&mut self, name: &'static str, command: Command) -> Result<bool, ServoError> {
        let is_accepted = self.take_over() && self.send(name, command)?;
        self.share();
        Ok(is_accepted)
    }

    /// Sends a command; a refusal becomes a warning on the page. Returns true if it was accepted.
    fn send(&mut self, name: &'static str, command: Command) -> Result<bool, ServoError> {
        match self.bench.station().command(name, command) {
            Ok(()) => return Ok(true),
            Err(error @ StationError::Denied { denial, .. }) => self.refused(&error, denial),
            Err(error) => self.forgive(error)?,
        }
        Ok(false)
    }

    /// Warns of a refusal, with its remedy.
    fn refused(&self, error: &StationError, denial: Denial) {
        let remedy = diagnosis::remedy(denial).map(|remedy| format!("; {remedy}"));
        self.hub
            .warn(format!("{error}{}", remedy.unwrap_or_default()));
    }

    /// Resets the station once its stage stands.
    fn try_reset(&mut self) -> Result<(), ServoError> {
        let Some(end) = self.reset else {
            return Ok(());
        };
        let station = self.bench.station();
        let state = station.status().map(|status: Status| status.state);
        let is_moving = state.is_none_or(State::is_moving);
        if is_moving && HostInstant::now() < end {
            return Ok(());
        }
        match station.command("reset", Command::Reset) {
            Ok(()) => self.reset = None,
            // The ramp or the report of the fault is still under way.
            Err(error) if error.is_passing() && HostInstant::now() < end => {}
            Err(error @ StationError::Denied { denial, .. }) => {
                self.reset = None;
                self.refused(&error, denial);
            }
            Err(error) => {
                self.reset = None;
                self.forgive(error)?;
            }
        }
        Ok(())
    }
}

//! A station, its cameras and the people at its live page: looks at the images all the time, and
//! follows, jogs, zeroes, homes and resets on request.
//!
//! The loop owns the station. Requests wait in a bounded queue that the loop empties between two
//! frame sets; only a stop does not wait: it goes to the station from the thread of the page.
//!
//! While nothing is followed, other runs of the program may drive the station through this one
//! ([`Access::Open`]).
//!
//! Each request is answered when the station has answered it. A jog that comes while the stage still
//! moves is refused, because the station would replace the rest of the earlier one.

use super::ServoError;
use super::live::LiveObserver;
use super::observer::ServoObserver;
use super::page_recording::PageRecording;
use super::station_link::{FrameRefusal, StationLink};
use super::visual_servo::{ServoOutcome, VisualServo};
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
use trinocular_live::controls::{Action, Offers, Reply};
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

/// Refusal of a jog in motion.
const STILL_MOVES: &str =
    "the stage still moves: wait until it stands, or stop it; this jog was not done";

/// Outcome of a request: done, or the reason why not, in words.
type Outcome = Result<(), String>;

/// Request of a page, and the way back to it.
#[derive(Debug)]
struct Request {
    action: Action,
    reply: Reply,
}

/// Reset that waits for the stage to stand.
#[derive(Debug)]
struct Reset {
    deadline: HostInstant,
    /// Way back to the page that asked for it.
    reply: Option<Reply>,
}

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
    requests: SyncSender<Request>,
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
        let _ = self.requests.try_send(Request {
            action: Action::Stop {},
            reply: Reply::new(|_| {}),
        });
    }

    fn request(&self, action: Action, reply: Reply) {
        // A request that comes back after the end of the run says so by itself.
        if let Err(TrySendError::Full(request)) = self.requests.try_send(Request { action, reply })
        {
            let reason = "the station is busy; try again".to_owned();
            request.reply.send(Err(reason));
        }
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
    requests: Receiver<Request>,
    servo: Option<VisualServo>,
    /// Way back to the page that asked to follow, until the station has answered a frame.
    starting: Option<Reply>,
    reset: Option<Reset>,
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
            starting: None,
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
        // A refusal is a warning on the page.
        let _ = self.begin();
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
            while let Ok(request) = self.requests.try_recv() {
                self.act(request)?;
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
                    let reason = format!("these images cannot be the reference: {refusal}");
                    self.hub.warn(reason.clone());
                    self.end_following(reason);
                }
            }
            return Ok(());
        }
        let station = self.bench.station();
        match servo.step(station, &shot.images, shot.taken, None) {
            Ok(step) => {
                self.judge_start(&step.outcome);
                Ok(())
            }
            Err(error) => self.forgive(error),
        }
    }

    /// Answers the page that asked to follow, by the station's answer to the first frame. A station
    /// that refuses what it has to do with its own condition is not asked again.
    fn judge_start(&mut self, outcome: &ServoOutcome) {
        let Some(reply) = self.starting.take() else {
            return;
        };
        match outcome {
            ServoOutcome::Unused(FrameRefusal::Denied(denial))
                if diagnosis::remedy(*denial).is_some() =>
            {
                let (command, denial) = ("following", *denial);
                let refusal = self.refused(&StationError::Denied { command, denial }, denial);
                self.end_following(refusal.clone());
                reply.send(Err(refusal));
            }
            // Images that give no measurement are no refusal: the target may come back.
            _ => reply.send(Ok(())),
        }
    }

    /// Goes on after an error that leaves the station in reach.
    fn forgive(&mut self, error: StationError) -> Result<(), ServoError> {
        match error {
            StationError::StoppedByOther { by } => {
                let reason = format!("stopped by {by}");
                // Requests from before the stop must not undo it.
                while let Ok(request) = self.requests.try_recv() {
                    request.reply.send(Err(reason.clone()));
                }
                self.cancel_reset(&reason);
                self.end_following(reason.clone());
                // The station itself stays stopped until a reset.
                if let Some(serial) = self.bench.station().serial_mut() {
                    serial.forgive_stop();
                }
                self.hub.warn(reason);
                Ok(())
            }
            StationError::Faulted(fault) => {
                let text = diagnosis::fault(fault);
                let reason = format!("fault {}: {}", fault.number(), text.cause);
                if self.servo.is_some() {
                    self.hub.warn(reason.clone());
                }
                self.end_following(reason);
                Ok(())
            }
            error @ StationError::Interrupted { .. } => {
                self.end_following(error.to_string());
                self.hub.warn(error.to_string());
                Ok(self.bench.station().resume(error)?)
            }
            error => Err(error.into()),
        }
    }

    /// Ends following; a page whose request to follow has no answer yet gets this reason.
    fn end_following(&mut self, reason: String) {
        if let Some(reply) = self.starting.take() {
            reply.send(Err(reason));
        }
        self.servo = None;
        self.keyframe = None;
        self.share();
        self.hub.set_following(false);
    }

    fn cancel_reset(&mut self, reason: &str) {
        if let Some(reply) = self.reset.take().and_then(|reset| reset.reply) {
            reply.send(Err(reason.to_owned()));
        }
    }

    /// Makes sure that no other run drives the station and that it has this run's configuration;
    /// a warning on the page says why not.
    fn take_over(&mut self) -> Outcome {
        let Some(serial) = self.bench.station().serial_mut() else {
            return Ok(());
        };
        let taken = serial
            .set_access(Access::Busy)
            .and_then(|()| serial.restore_configuration());
        taken.map_err(|error| {
            self.hub.warn(error.to_string());
            self.share();
            error.to_string()
        })
    }

    /// Starts to follow with the next images, if the station is ready for it.
    fn begin(&mut self) -> Outcome {
        let station = self.bench.station();
        // A status from before the last command would name a state that has passed.
        let fresh = station
            .serial()
            .and_then(|serial| serial.fresh_status(true).ok());
        let status = fresh.or_else(|| station.status());
        let unready = status.and_then(|status| {
            let state = diagnosis::state(status.state).name;
            let next = diagnosis::next_step(&status)?;
            Some(format!(
                "cannot follow: the station is {state}; to do: {next}"
            ))
        });
        if let Some(reason) = unready {
            self.hub.warn(reason.clone());
            return Err(reason);
        }
        self.take_over()?;
        match VisualServo::new(&self.rig, self.estimator) {
            Ok(mut servo) => {
                servo.set_observers(self.observers());
                self.servo = Some(servo);
                self.hub.set_following(true);
                Ok(())
            }
            Err(refusal) => {
                self.hub.warn(refusal.to_string());
                self.share();
                Err(refusal.to_string())
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
    fn record(&mut self, on: bool) -> Outcome {
        let station = self.bench.station();
        match on {
            true => {
                let view = (&self.rig, self.keyframe.as_ref());
                let begun = self.recording.begin(&self.hub, station, view);
                begun.inspect_err(|reason| self.hub.warn(reason.clone()))?;
            }
            false => self.recording.end(&self.hub, station),
        }
        let observers = self.observers();
        if let Some(servo) = &mut self.servo {
            servo.set_observers(observers);
        }
        Ok(())
    }

    fn act(&mut self, Request { action, reply }: Request) -> Result<(), ServoError> {
        match action {
            Action::Reset {} => {
                self.cancel_reset("another reset follows");
                self.begin_reset(Some(reply));
            }
            Action::Follow { on: true } if self.servo.is_none() => match self.begin() {
                Ok(()) => self.starting = Some(reply),
                refused => reply.send(refused),
            },
            Action::Mark { text } => {
                reply.send(Ok(()));
                self.recording.event("mark", &text);
                self.hub.mark(text);
            }
            action => {
                let is_zero = matches!(action, Action::Zero {});
                let outcome = self.perform(action)?;
                let is_done = outcome.is_ok();
                reply.send(outcome);
                if is_zero && is_done {
                    self.hub.note("zero is here");
                }
            }
        }
        Ok(())
    }

    fn begin_reset(&mut self, reply: Option<Reply>) {
        let deadline = HostInstant::now() + REST_PATIENCE;
        self.reset = Some(Reset { deadline, reply });
    }

    /// Does an action whose outcome is known at its end.
    fn perform(&mut self, action: Action) -> Result<Outcome, ServoError> {
        match action {
            Action::Stop {} => {
                // A reset from before the stop must not undo it.
                self.cancel_reset("a stop came after it");
                // Stopped already from the thread of the page; this notices it if nothing moves.
                let station = self.bench.station();
                match station.serial().map(|serial| serial.check()) {
                    Some(Err(error)) => self.forgive(error)?,
                    _ => return self.send("stop", Command::Stop),
                }
            }
            Action::Follow { on: false } if self.servo.is_some() => {
                self.end_following("following was ended".to_owned());
                self.hub.note("following ended");
                // A stop and a reset: the stage comes to rest instead of running on to its
                // prediction, and is ready again.
                let stopped = self.send("stop", Command::Stop)?;
                self.begin_reset(None);
                return Ok(stopped);
            }
            Action::Record { on } => return Ok(self.record(on)),
            Action::Jog { .. } | Action::Zero {} | Action::Home {} if self.servo.is_some() => {
                return Ok(self.refuse("end following first"));
            }
            Action::Jog { .. } if self.is_moving() => return Ok(self.refuse(STILL_MOVES)),
            Action::Jog { distance_um } => return self.drive("jog", Command::Jog { distance_um }),
            Action::Zero {} => return self.drive("zero", Command::Zero),
            Action::Home {} => {
                let axes = self.stage.care.home.map(|home| home.is_some());
                return self.drive("home", Command::Home { axes });
            }
            // Following is as it should be already; the others have their own ways.
            Action::Follow { .. } | Action::Reset {} | Action::Mark { .. } => {}
        }
        Ok(Ok(()))
    }

    fn refuse(&self, reason: &str) -> Outcome {
        self.hub.warn(reason);
        Err(reason.to_owned())
    }

    fn is_moving(&mut self) -> bool {
        let station = self.bench.station();
        match station.serial() {
            Some(serial) => serial.is_moving(),
            None => station
                .status()
                .is_some_and(|status| status.state.is_moving()),
        }
    }

    /// Sends a command that needs the station for this run.
    fn drive(&mut self, name: &'static str, command: Command) -> Result<Outcome, ServoError> {
        let outcome = match self.take_over() {
            Ok(()) => self.send(name, command)?,
            refused => refused,
        };
        self.share();
        Ok(outcome)
    }

    /// Sends a command and waits for the answer; a refusal also becomes a warning on the page.
    fn send(&mut self, name: &'static str, command: Command) -> Result<Outcome, ServoError> {
        match self.bench.station().command(name, command) {
            Ok(()) => Ok(Ok(())),
            Err(error @ StationError::Denied { denial, .. }) => {
                Ok(Err(self.refused(&error, denial)))
            }
            Err(error) => {
                let reason = error.to_string();
                self.forgive(error)?;
                Ok(Err(reason))
            }
        }
    }

    /// Warns of a refusal, with its remedy; returns both in words.
    fn refused(&self, error: &StationError, denial: Denial) -> String {
        let remedy = diagnosis::remedy(denial).map(|remedy| format!("; {remedy}"));
        let text = format!("{error}{}", remedy.unwrap_or_default());
        self.hub.warn(text.clone());
        text
    }

    /// Resets the station once its stage stands.
    fn try_reset(&mut self) -> Result<(), ServoError> {
        let Some(end) = self.reset.as_ref().map(|reset| reset.deadline) else {
            return Ok(());
        };
        let station = self.bench.station();
        let state = station.status().map(|status: Status| status.state);
        let is_moving = state.is_none_or(State::is_moving);
        if is_moving && HostInstant::now() < end {
            return Ok(());
        }
        let outcome = match station.command("reset", Command::Reset) {
            // The ramp or the report of the fault is still under way.
            Err(error) if error.is_passing() && HostInstant::now() < end => return Ok(()),
            outcome => outcome,
        };
        let reply = self.reset.take().and_then(|reset| reset.reply);
        let outcome = match outcome {
            Ok(()) => Ok(()),
            Err(error @ StationError::Denied { denial, .. }) => Err(self.refused(&error, denial)),
            Err(error) => {
                let reason = error.to_string();
                self.forgive(error)?;
                Err(reason)
            }
        };
        if let Some(reply) = reply {
            reply.send(outcome);
        }
        Ok(())
    }
}

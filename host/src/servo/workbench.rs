//! A station, its cameras and the people at its live page: looks at the images all the time, and
//! follows, jogs, zeroes, homes and resets on request.
//!
//! The loop owns the station. Requests wait in a bounded queue that the loop empties between two
//! frame sets; only a stop does not wait: it goes to the station from the thread of the page.
//!
//! While nothing is followed, other runs of the program may drive the station through this one
//! ([`Access::Open`]).
//!
//! Each request is answered when the station has answered it (`actions`). A jog that comes while
//! the stage still moves is refused, because the station would replace the rest of the earlier one.

mod actions;
mod desk;

pub use desk::Desk;

use super::ServoError;
use super::live::LiveObserver;
use super::observer::{ServoEvent, ServoObserver};
use super::page_recording::PageRecording;
use super::recording::{FrameSetTaker, Takers, observers_of};
use super::station_link::{FrameRefusal, StationLink};
use super::visual_servo::{ServoOutcome, VisualServo};
use desk::Request;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::{Duration, Instant as HostInstant};
use trinocular_client::StationError;
use trinocular_client::diagnosis;
use trinocular_client::serial::Access;
use trinocular_core::frame::message::Status;
use trinocular_core::rig::Rig;
use trinocular_core::time::Instant;
use trinocular_live::Hub;
use trinocular_live::controls::{Offers, Reply};
use trinocular_rig::pivot::Pivot;
use trinocular_rig::rig_file::Stage;
use trinocular_vision::flow::region::Regions;
use trinocular_vision::images::FrameSet;
use trinocular_vision::sums::Estimator;

/// Requests that wait; further ones are refused.
const REQUESTS: usize = 16;

/// Longest time for a stage to come to rest before a reset.
const REST_PATIENCE: Duration = Duration::from_secs(10);

/// Outcome of a request: done, or the reason why not, in words.
type Outcome = Result<(), String>;

/// Reset that waits for the stage to stand.
#[derive(Debug)]
struct Reset {
    deadline: HostInstant,
    /// Name of who asked for it.
    by: &'static str,
    /// Way back to who asked for it.
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

    /// Takes what has happened at the cameras since the last call, in words.
    fn take_news(&mut self) -> Vec<String> {
        Vec::new()
    }
}

/// Loop that owns the station.
#[derive(Debug)]
pub struct Workbench<B> {
    bench: B,
    rig: Rig,
    stage: Stage,
    estimator: Estimator,
    /// Point of a turning target that is followed, if its rotation is estimated.
    pivot: Option<Pivot>,
    regions: Regions,
    hub: Arc<Hub>,
    requests: Receiver<Request>,
    servo: Option<VisualServo>,
    /// Way back to the page that asked to follow, until the station has answered a frame.
    starting: Option<Reply>,
    reset: Option<Reset>,
    recording: PageRecording,
    /// Other takers of what is followed.
    takers: Takers,
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
            by: desk::PAGE,
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
            pivot: None,
            regions: Regions::default(),
            hub,
            requests,
            servo: None,
            starting: None,
            reset: None,
            recording,
            takers: Takers::new(),
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

    /// Estimates the rotation of the target and follows this point of it, or refuses a target that
    /// turns, from the next start on.
    pub fn set_pivot(&mut self, pivot: Option<Pivot>) {
        self.pivot = pivot;
    }

    /// Restricts the points to regions of the cameras' images from the next keyframe on.
    pub fn set_regions(&mut self, regions: Regions) {
        self.regions = regions;
    }

    /// Passes what is followed to another taker, from the next start on.
    pub fn pass_to(&mut self, taker: Arc<dyn FrameSetTaker>) {
        self.takers.push(taker);
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
            self.tell_deeds();
            self.tell_news();
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

    /// Tells the pages and the recording what other programs have done at the station.
    fn tell_deeds(&mut self) {
        let deeds = self
            .bench
            .station()
            .serial()
            .map(|serial| serial.take_deeds());
        for deed in deeds.into_iter().flatten() {
            let text = deed.to_string();
            self.recording.event("guest", &text);
            self.hub.note(text);
        }
    }

    /// Tells the pages and the recording what has happened at the cameras.
    fn tell_news(&mut self) {
        for news in self.bench.take_news() {
            self.recording.event("cameras", &news);
            self.hub.warn(news);
        }
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
                let undone = format!("not done, because the stage was {reason}; ask again");
                while let Ok(request) = self.requests.try_recv() {
                    request.reply.send(Err(undone.clone()));
                }
                self.cancel_reset(&undone);
                self.end_following(reason.clone());
                self.recording.event("stop", &reason);
                // The station itself stays stopped until a reset.
                if let Some(serial) = self.bench.station().serial_mut() {
                    serial.forgive_stop();
                }
                self.hub.warn(reason);
                Ok(())
            }
            StationError::Faulted(fault) => {
                // The page has it from the status.
                let text = diagnosis::fault(fault);
                self.end_following(format!("fault {}: {}", fault.number(), text.cause));
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

    /// Asks a station on a line for its status. One from before the last command would name a state
    /// that has passed.
    fn fresh_status(&mut self) -> Option<Status> {
        let serial = self.bench.station().serial()?;
        serial.fresh_status(true).ok()
    }

    /// Starts to follow with the next images, if the station is ready for it.
    fn begin(&mut self) -> Outcome {
        let fresh = self.fresh_status();
        let unready = fresh.or_else(|| self.bench.station().status());
        let unready = unready.and_then(|status| {
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
                servo.set_pivot(self.pivot);
                servo.set_regions(self.regions.clone());
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

    /// Makes the observers of the loop: the pages, the recording if there is one, and the takers.
    fn observers(&self) -> Vec<Box<dyn ServoObserver>> {
        let mut observers = self.recording.observers(&self.rig);
        observers.extend(observers_of(self.takers.iter().cloned(), &self.rig));
        observers.push(Box::new(LiveObserver::new(Arc::clone(&self.hub))));
        observers
    }

    /// Starts or ends a recording, and goes on with what is followed.
    fn record(&mut self, on: bool) -> Outcome {
        let station = self.bench.station();
        match on {
            true => {
                let last_pose = self.servo.as_ref().and_then(VisualServo::last_pose);
                let keyframe = self.keyframe.as_ref();
                let keyframe = keyframe.map(|images| ServoEvent::Keyframe { images, last_pose });
                let view = (&self.rig, keyframe);
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
}

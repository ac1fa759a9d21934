//! Recordings that are started and ended on a page while the run goes on.

use super::observer::{ServoEvent, ServoObserver as _};
use super::recording::{FrameSetTaker, RecordingObserver, observers};
use super::station_link::StationLink;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use trinocular_client::observer::StationObserver;
use trinocular_core::rig::Rig;
use trinocular_live::Hub;
use trinocular_recording::recorder::Tap;
use trinocular_rig::error::InputError;

/// Maker of recordings.
pub trait Recordings: std::fmt::Debug + Send {
    /// Begins a recording in a new file; returns the file's name and the taps.
    ///
    /// # Errors
    /// The reason why there is no file, in words.
    fn begin(&mut self) -> Result<(String, Arc<Tap>), String>;

    /// Ends the recording. The rest, which waits for the disk, is returned.
    fn end(&mut self) -> Finish;
}

/// Rest of the end of a recording: it returns the account of the file in words, or the error that
/// ended the file early.
pub type Finish = Box<dyn FnOnce() -> Result<String, InputError> + Send>;

/// Recording of a run: one for the whole run, or those that its pages ask for.
#[derive(Debug, Default)]
pub struct PageRecording {
    recordings: Option<Box<dyn Recordings>>,
    /// Taps of the recording under way.
    tap: Option<Arc<Tap>>,
    /// Thread that waits for the file of the recording before.
    finishing: Option<JoinHandle<()>>,
    /// First error of a file that was ended early.
    failed: Arc<Mutex<Option<InputError>>>,
}

impl PageRecording {
    /// Records the whole run with these taps; pages cannot end it.
    pub fn whole(tap: Option<Arc<Tap>>) -> Self {
        Self {
            tap,
            ..Self::default()
        }
    }

    /// Records what the pages ask for.
    pub fn on_request(recordings: Box<dyn Recordings>) -> Self {
        Self {
            recordings: Some(recordings),
            ..Self::default()
        }
    }

    /// Returns true if pages may start and end recordings.
    pub fn is_on_request(&self) -> bool {
        self.recordings.is_some()
    }

    /// Returns the observer of the station's line, if the whole run is recorded.
    pub fn station_observer(&self) -> Option<Arc<dyn StationObserver>> {
        let tap = self.tap.clone()?;
        Some(tap)
    }

    /// Begins a recording. While the run follows, the recording begins with the images of the
    /// keyframe and the last pose, so that a replay can measure the later ones.
    ///
    /// # Errors
    /// The reason why it cannot begin, in words.
    pub fn begin(
        &mut self,
        hub: &Hub,
        station: &mut StationLink,
        (rig, keyframe): (&Rig, Option<ServoEvent<'_>>),
    ) -> Result<(), String> {
        let Some(recordings) = &mut self.recordings else {
            return Err("this run is recorded as a whole, or not at all".to_owned());
        };
        if self.tap.is_some() {
            return Ok(());
        }
        let is_finishing = |thread: &JoinHandle<()>| !thread.is_finished();
        if self.finishing.as_ref().is_some_and(is_finishing) {
            return Err("the recording before is still being written; try again".to_owned());
        }
        let (file, tap) = recordings.begin()?;
        station.set_observer(Some(Arc::clone(&tap) as Arc<dyn StationObserver>));
        tap.reach(station.now().micros());
        if let Some(keyframe) = keyframe {
            let taker = Arc::clone(&tap) as Arc<dyn FrameSetTaker>;
            let mut observer = RecordingObserver::new(taker, rig);
            observer.observe(&keyframe);
        }
        self.tap = Some(tap);
        hub.set_recording(Some(file));
        Ok(())
    }

    /// Ends a recording that a page started. A thread waits for the disk, so that the loop does not.
    pub fn end(&mut self, hub: &Arc<Hub>, station: &mut StationLink) {
        let Some(recordings) = &mut self.recordings else {
            return;
        };
        let Some(tap) = self.tap.take() else {
            return;
        };
        station.set_observer(None);
        tap.end(station.now().micros());
        drop(tap);
        let finish = recordings.end();
        let hub = Arc::clone(hub);
        let failed = Arc::clone(&self.failed);
        self.finishing = Some(std::thread::spawn(move || {
            match finish() {
                Ok(account) => hub.note(account),
                Err(error) => {
                    hub.warn(error.to_string());
                    let mut failed = failed.lock().unwrap_or_else(PoisonError::into_inner);
                    failed.get_or_insert(error);
                }
            }
            hub.set_recording(None);
        }));
    }

    /// Ends a recording whose file cannot be written further, and warns of it.
    pub fn check(&mut self, hub: &Arc<Hub>, station: &mut StationLink) {
        if !self.tap.as_ref().is_some_and(|tap| tap.has_failed()) {
            return;
        }
        if self.is_on_request() {
            return self.end(hub, station);
        }
        // The run's own end has the error.
        station.set_observer(None);
        self.tap = None;
        hub.warn("the recording has ended, because its file cannot be written");
    }

    /// Waits for the file of a recording that was ended.
    ///
    /// # Errors
    /// The first error of a file that was ended early.
    pub fn wait(&mut self) -> Result<(), InputError> {
        if let Some(thread) = self.finishing.take() {
            let _ = thread.join();
        }
        let mut failed = self.failed.lock().unwrap_or_else(PoisonError::into_inner);
        failed.take().map_or(Ok(()), Err)
    }

    /// Notes an event in the recording under way.
    pub fn event(&self, kind: &'static str, text: &str) {
        if let Some(tap) = &self.tap {
            tap.event(kind, text.to_owned());
        }
    }

    /// Returns the observers of a loop that is recorded.
    pub fn observers(&self, rig: &Rig) -> Vec<Box<dyn super::observer::ServoObserver>> {
        observers(self.tap.clone(), rig)
    }
}

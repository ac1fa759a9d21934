//! Latest state of a run, as the pages see it.
//!
//! The loop writes, the pages read; both hold the lock only to copy. Nothing here waits for a page.

use crate::access;
use crate::controls::Controls;
use crate::images::{Encoded, Encoder, Points, Shot, Slot};
use crate::state::State;
#[cfg(feature = "foxglove")]
use crate::telemetry::Sample;
use serde_json::{Value, json};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use tokio::sync::watch;
use trinocular_core::frame::message::{Mounting, Status};
use trinocular_core::rig::Rig;
use trinocular_rig::rig_file::Stage;
use trinocular_vision::flow::{CameraRefusal, Measurement};
use trinocular_vision::images::FrameSet;

/// Facts that hold for a whole run.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Name of the station.
    pub station: String,
    /// Names of the cameras, in the rig's order.
    pub cameras: Vec<String>,
    /// The cameras.
    pub rig: Rig,
    /// The stage.
    pub stage: Stage,
    /// Place of the cameras.
    pub mounting: Mounting,
    /// Origin of mm and limits, in words, if it is not the station.
    pub scale: Option<String>,
}

/// One turn of the loop.
#[derive(Clone, Copy, Debug)]
pub struct Turn<'a> {
    /// Capture time, µs on any clock that goes on for the whole run.
    pub taken_us: u64,
    /// Images of all cameras.
    pub images: &'a FrameSet,
    /// Measurement in the images, if there is one.
    pub measurement: Option<&'a Measurement>,
    /// Estimate of the station, if it used the frame.
    pub estimate: Option<Estimate>,
    /// Reason why the images had no effect: its name for the counts, and the whole sentence.
    pub refusal: Option<(&'static str, &'a str)>,
    /// Cameras that took no part, from 0, each with its reason.
    pub absent: &'a [(usize, CameraRefusal)],
    /// Position of the stage, mm.
    pub stage_mm: [f64; 3],
    /// Latest status of the station.
    pub status: Option<&'a Status>,
}

/// Estimate of the station from one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Displacement of the target since the keyframe, mm, camera axes.
    pub displacement_mm: [f64; 3],
    /// Standard deviation of the displacement, mm.
    pub sigma_mm: Option<[f64; 3]>,
    /// Points behind the estimate.
    pub points: usize,
    /// Latency from the images to the first step that they could change, µs.
    pub latency_us: u32,
}

/// State of a run, shared by its loop and its pages.
#[derive(Debug)]
pub struct Hub {
    setup: Setup,
    state: Mutex<State>,
    changed: watch::Sender<u64>,
    slot: Slot,
    clients: AtomicUsize,
    controls: Mutex<Option<ControlsHandle>>,
    drop_source: OnceLock<DropSource>,
}

/// Function that counts the images of each camera that never came to the loop, by reason.
pub struct DropSource(Box<CountDrops>);

type CountDrops = dyn Fn() -> Vec<Vec<(&'static str, u64)>> + Send + Sync;

impl DropSource {
    /// Makes the source from a function that is called on the threads of the pages.
    pub fn new(count: impl Fn() -> Vec<Vec<(&'static str, u64)>> + Send + Sync + 'static) -> Self {
        Self(Box::new(count))
    }
}

impl std::fmt::Debug for DropSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DropSource").finish_non_exhaustive()
    }
}

/// Controls of a run and the access to them.
#[derive(Clone)]
pub(crate) struct ControlsHandle {
    pub controls: Arc<dyn Controls>,
    pub access: Arc<access::Access>,
}

impl std::fmt::Debug for ControlsHandle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ControlsHandle").finish_non_exhaustive()
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Hub {
    /// Makes the hub of a run and starts its encoder, which ends within 200 ms of the hub's last use.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub fn start(setup: Setup) -> std::io::Result<Arc<Self>> {
        let cameras = setup.cameras.len();
        let hub = Arc::new(Self {
            setup,
            state: Mutex::new(State::new(cameras)),
            changed: watch::Sender::new(0),
            slot: Slot::default(),
            clients: AtomicUsize::new(0),
            controls: Mutex::default(),
            drop_source: OnceLock::new(),
        });
        let mut encoder = Encoder::new(&hub.setup.rig);
        let theirs = Arc::downgrade(&hub);
        let run = move || {
            while let Some(hub) = theirs.upgrade() {
                let Some(shot) = hub.slot.take() else {
                    continue;
                };
                let encoded = encoder.encode(&shot);
                lock(&hub.state).encoded = Some(encoded);
                hub.notify();
            }
        };
        let name = "live images".to_owned();
        std::thread::Builder::new().name(name).spawn(run)?;
        Ok(hub)
    }

    fn notify(&self) {
        self.changed.send_modify(|count| *count += 1);
    }

    /// Takes in one turn of the loop.
    pub fn turn(&self, turn: &Turn<'_>) {
        self.offer_images(turn);
        lock(&self.state).take(&self.setup, turn);
        self.notify();
    }

    /// Takes in images that are not measured, while the run follows nothing.
    pub fn look(
        &self,
        taken_us: u64,
        images: &FrameSet,
        stage_mm: [f64; 3],
        status: Option<&Status>,
    ) {
        self.turn(&Turn {
            taken_us,
            images,
            measurement: None,
            estimate: None,
            refusal: None,
            absent: &[],
            stage_mm,
            status,
        });
    }

    /// Sets whether the run follows its target at present.
    pub fn set_following(&self, is_following: bool) {
        lock(&self.state).is_following = is_following;
        self.notify();
    }

    /// Sets the name of the file that the run is recorded in, if it is recorded.
    pub fn set_recording(&self, file: Option<String>) {
        lock(&self.state).recording = file;
        self.notify();
    }

    /// Shows, beside the cameras that the loop leaves out, the images that never came to it. The
    /// first source stays.
    pub fn set_drop_source(&self, source: DropSource) {
        let _ = self.drop_source.set(source);
    }

    /// Adds a note to the list of every page.
    pub fn note(&self, text: impl Into<String>) {
        self.add_note("note", text.into());
    }

    /// Adds a warning to the list of every page.
    pub fn warn(&self, text: impl Into<String>) {
        self.add_note("warning", text.into());
    }

    /// Adds a mark to the list of every page.
    pub fn mark(&self, text: impl Into<String>) {
        self.add_note("mark", text.into());
    }

    fn add_note(&self, kind: &'static str, text: String) {
        lock(&self.state).note(kind, text);
        self.notify();
    }

    /// Tells the pages that the run has ended.
    pub fn end(&self) {
        lock(&self.state).has_ended = true;
        self.notify();
    }

    /// Gives the pages that were opened by the control link of `access` these controls, and
    /// announces the link.
    pub fn set_controls(&self, controls: Arc<dyn Controls>, access: Arc<access::Access>) {
        let announced = Arc::clone(&access);
        *lock(&self.controls) = Some(ControlsHandle { controls, access });
        // Only now does the link open the controls.
        announced.announce();
    }

    pub(crate) fn controls(&self) -> Option<ControlsHandle> {
        lock(&self.controls).clone()
    }

    /// Returns the number of open pages.
    pub fn clients(&self) -> usize {
        self.clients.load(Ordering::Relaxed)
    }

    pub(crate) fn client_came(&self) {
        self.clients.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn client_left(&self) {
        self.clients.fetch_sub(1, Ordering::Relaxed);
    }

    pub(crate) fn subscribe(&self) -> watch::Receiver<u64> {
        self.changed.subscribe()
    }

    pub(crate) fn encoded(&self) -> Option<Encoded> {
        lock(&self.state).encoded.clone()
    }

    /// Returns the names of the cameras.
    #[cfg(feature = "foxglove")]
    pub(crate) fn cameras(&self) -> &[String] {
        &self.setup.cameras
    }

    /// Returns the samples after number `seen`, and the number of the last one.
    #[cfg(feature = "foxglove")]
    pub(crate) fn samples_since(&self, seen: u64) -> (Vec<Sample>, u64) {
        lock(&self.state).samples.since(seen)
    }

    /// Copies the images into the slot if they will be sent.
    fn offer_images(&self, turn: &Turn<'_>) {
        if self.clients() == 0 || !self.slot.is_due() {
            return;
        }
        let at_s = lock(&self.state).since_first_s(turn.taken_us);
        self.slot.put(Shot {
            at_s,
            images: turn.images.clone(),
            points: turn.measurement.map(Points::of),
        });
    }

    /// Returns the message that a page gets first.
    pub(crate) fn hello(&self) -> Value {
        let Setup {
            station,
            cameras,
            rig,
            stage,
            mounting,
            scale,
        } = &self.setup;
        let offers = self.controls().map(|handle| handle.controls.offers());
        json!({
            "type": "hello",
            "version": env!("CARGO_PKG_VERSION"),
            "station": station,
            "cameras": cameras,
            "size_px": rig.image_size_px,
            "travel_mm": stage.travel_mm,
            "scale": scale,
            "on_stage": *mounting == Mounting::OnStage,
            "has_control": offers.is_some(),
            "offers": offers.unwrap_or_default(),
        })
    }

    /// Returns the present state for scripts: with the last sample by names instead of all samples.
    pub(crate) fn present(&self) -> Value {
        let latest = lock(&self.state).latest();
        let (mut state, _, _) = self.state_since(u64::MAX, 0);
        if let Some(fields) = state.as_object_mut() {
            fields.remove("samples");
            fields.insert("latest".to_owned(), latest);
        }
        state
    }

    /// Returns the state with the samples after number `seen` and the notes after `noted`, and the
    /// numbers of the last ones.
    pub(crate) fn state_since(&self, seen: u64, noted: u64) -> (Value, u64, u64) {
        // The lock is held only to copy, because the loop waits for it.
        let mut snapshot = lock(&self.state).snapshot(seen, noted);
        if let Some(DropSource(count)) = self.drop_source.get() {
            snapshot.add_drops(&count());
        }
        let (sample, note) = (snapshot.last_sample, snapshot.last_note);
        (snapshot.into_json(), sample, note)
    }
}

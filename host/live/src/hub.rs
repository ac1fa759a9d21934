//! Latest state of a run, as the pages see it.
//!
//! The loop writes, the pages read; both hold the lock only to copy. Nothing here waits for a page.

use crate::access;
use crate::controls::Controls;
use crate::images::{Encoded, Encoder, Points, RATE_HZ, Shot};
use crate::telemetry::{Counts, Sample, Samples, count};
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::watch;
use trinocular_client::diagnosis;
use trinocular_core::frame::message::{Mounting, Status};
use trinocular_core::rig::Rig;
use trinocular_rig::rig_file::Stage;
use trinocular_vision::flow::{CameraRefusal, Measurement};
use trinocular_vision::images::FrameSet;

/// Notes that are kept.
const NOTES: usize = 30;

/// Reasons that are counted; further ones count as one.
const REASONS: usize = 40;

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
    slot: Mutex<Slot>,
    filled: Condvar,
    clients: AtomicUsize,
    controls: Mutex<Option<ControlsHandle>>,
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

/// Note for the people at the pages.
#[derive(Clone, Debug)]
struct Note {
    number: u64,
    at_s: f64,
    kind: &'static str,
    text: String,
}

#[derive(Debug, Default)]
struct State {
    samples: Samples,
    /// Capture time of the first turn, µs.
    first_us: Option<u64>,
    at_s: f64,
    status: Option<Status>,
    is_following: bool,
    turns: u64,
    refusals: Counts,
    refusal: Option<String>,
    /// Drops per camera, by reason.
    drops: Vec<Counts>,
    notes: VecDeque<Note>,
    note_count: u64,
    encoded: Option<Encoded>,
    has_ended: bool,
}

#[derive(Debug, Default)]
struct Slot {
    shot: Option<Shot>,
    last: Option<Instant>,
    is_closed: bool,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Hub {
    /// Makes the hub of a run and starts its encoder, which ends with the hub.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub fn start(setup: Setup) -> std::io::Result<Arc<Self>> {
        let cameras = setup.cameras.len();
        let hub = Arc::new(Self {
            setup,
            state: Mutex::new(State {
                drops: vec![Counts::new(); cameras],
                ..State::default()
            }),
            changed: watch::Sender::new(0),
            slot: Mutex::default(),
            filled: Condvar::new(),
            clients: AtomicUsize::new(0),
            controls: Mutex::default(),
        });
        let mut encoder = Encoder::new(&hub.setup.rig);
        let theirs = Arc::downgrade(&hub);
        let run = move || {
            while let Some(hub) = theirs.upgrade() {
                let Some(shot) = hub.next_shot() else {
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

    /// Waits a moment for images in the slot.
    fn next_shot(&self) -> Option<Shot> {
        let slot = lock(&self.slot);
        let is_empty = |slot: &mut Slot| slot.shot.is_none() && !slot.is_closed;
        let wait = Duration::from_millis(200);
        let waited = self.filled.wait_timeout_while(slot, wait, is_empty);
        let (mut slot, _) = waited.unwrap_or_else(PoisonError::into_inner);
        slot.shot.take()
    }

    fn notify(&self) {
        self.changed.send_modify(|count| *count += 1);
    }

    /// Takes in one turn of the loop.
    pub fn turn(&self, turn: &Turn<'_>) {
        self.offer_images(turn);
        {
            let mut state = lock(&self.state);
            state.begin_turn(turn);
            let sample = self.sample(state.at_s, turn);
            state.samples.push(sample);
            state.take(turn);
        }
        self.notify();
    }

    /// Takes in images that are not measured, because the run only looks.
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

    /// Takes in a status of the station between two turns.
    pub fn status(&self, status: &Status) {
        lock(&self.state).status = Some(*status);
        self.notify();
    }

    /// Counts images of a camera that were not used before they came to the loop, for instance
    /// damaged ones: total so far, by reason.
    pub fn set_drops(&self, camera: usize, reason: &str, total: u64) {
        let mut state = lock(&self.state);
        if let Some(counts) = state.drops.get_mut(camera)
            && total > 0
        {
            counts.insert(reason.to_owned(), total);
        }
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
        let mut state = lock(&self.state);
        state.note_count += 1;
        if state.notes.len() == NOTES {
            state.notes.pop_front();
        }
        let (number, at_s) = (state.note_count, state.at_s);
        state.notes.push_back(Note {
            number,
            at_s,
            kind,
            text,
        });
        drop(state);
        self.notify();
    }

    /// Tells the pages that the run has ended.
    pub fn end(&self) {
        lock(&self.state).has_ended = true;
        self.notify();
    }

    /// Gives the pages that were opened by the control link of `access` these controls.
    pub fn set_controls(&self, controls: Arc<dyn Controls>, access: Arc<access::Access>) {
        *lock(&self.controls) = Some(ControlsHandle { controls, access });
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
    pub fn cameras(&self) -> &[String] {
        &self.setup.cameras
    }

    /// Returns the samples after number `seen`, and the number of the last one.
    #[cfg(feature = "foxglove")]
    pub(crate) fn samples_since(&self, seen: u64) -> (Vec<Sample>, u64) {
        lock(&self.state).samples.since(seen)
    }

    /// Copies the images into the slot if they will be sent.
    fn offer_images(&self, turn: &Turn<'_>) {
        if self.clients() == 0 {
            return;
        }
        let mut slot = lock(&self.slot);
        let now = Instant::now();
        let period = Duration::from_secs_f64(0.9 / RATE_HZ);
        let is_due = slot.last.is_none_or(|last| now - last >= period);
        if slot.shot.is_some() || !is_due {
            return;
        }
        slot.last = Some(now);
        let at_s = lock(&self.state).since_first_s(turn.taken_us);
        slot.shot = Some(Shot {
            at_s,
            images: turn.images.clone(),
            points: turn.measurement.map(Points::of),
        });
        self.filled.notify_one();
    }

    /// Computes the numbers of a turn.
    fn sample(&self, at_s: f64, turn: &Turn<'_>) -> Sample {
        let on_stage = |displacement_mm: [f64; 3]| -> [f64; 3] {
            self.setup
                .stage
                .matrix
                .map(|row| (0..3).map(|i| row[i] * displacement_mm[i]).sum())
        };
        let displacement_mm = turn.estimate.map(|estimate| estimate.displacement_mm);
        let minus = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|i| a[i] - b[i]);
        let plus = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|i| a[i] + b[i]);
        let in_space = displacement_mm.map(on_stage);
        let (error_mm, target_mm) = match self.setup.mounting {
            Mounting::OnStage => (
                displacement_mm,
                in_space.map(|way| plus(turn.stage_mm, way)),
            ),
            Mounting::Fixed => (in_space.map(|way| minus(way, turn.stage_mm)), in_space),
        };
        Sample {
            at_s,
            displacement_mm,
            sigma_mm: turn.estimate.and_then(|estimate| estimate.sigma_mm),
            error_um: error_mm.map(|mm| mm.map(|mm| 1e3 * mm)),
            stage_mm: turn.stage_mm,
            target_mm,
            latency_ms: (turn.estimate).map(|estimate| f64::from(estimate.latency_us) * 1e-3),
            points: turn.estimate.map_or(0, |estimate| estimate.points),
        }
    }

    /// Returns the message that a page gets first.
    pub(crate) fn hello(&self) -> Value {
        let Setup {
            station,
            cameras,
            rig,
            stage,
            mounting,
        } = &self.setup;
        let offers = self.controls().map(|handle| handle.controls.offers());
        json!({
            "type": "hello",
            "version": env!("CARGO_PKG_VERSION"),
            "station": station,
            "cameras": cameras,
            "size_px": rig.image_size_px,
            "travel_mm": stage.travel_mm,
            "on_stage": *mounting == Mounting::OnStage,
            "has_control": offers.is_some(),
            "offers": offers.unwrap_or_default(),
        })
    }

    /// Returns the state with the samples after number `seen` and the notes after `noted`, and the
    /// numbers of the last ones.
    pub(crate) fn state_since(&self, seen: u64, noted: u64) -> (Value, u64, u64) {
        let state = lock(&self.state);
        let (samples, last) = state.samples.since(seen);
        let notes = state.notes.iter().filter(|note| note.number > noted);
        let notes: Vec<Value> = notes
            .map(|note| json!({"at_s": note.at_s, "kind": note.kind, "text": note.text}))
            .collect();
        let message = json!({
            "type": "state",
            "at_s": state.at_s,
            "samples": samples,
            "notes": notes,
            "following": state.is_following,
            "ended": state.has_ended,
            "station": state.status.as_ref().map(condition),
            "rate_hz": state.samples.rate_hz(),
            "latency_ms": state.samples.latency_ms(),
            "turns": state.turns,
            "refusals": state.refusals,
            "refusal": state.refusal,
            "drops": state.drops,
        });
        (message, last, state.note_count)
    }
}

impl Drop for Hub {
    fn drop(&mut self) {
        lock(&self.slot).is_closed = true;
        self.filled.notify_all();
    }
}

impl State {
    fn since_first_s(&self, taken_us: u64) -> f64 {
        let first_us = self.first_us.unwrap_or(taken_us);
        taken_us.saturating_sub(first_us) as f64 * 1e-6
    }

    fn begin_turn(&mut self, turn: &Turn<'_>) {
        self.first_us.get_or_insert(turn.taken_us);
        self.at_s = self.since_first_s(turn.taken_us);
        self.turns += 1;
    }

    fn take(&mut self, turn: &Turn<'_>) {
        if let Some(status) = turn.status {
            self.status = Some(*status);
        }
        self.refusal = turn.refusal.map(|(_, sentence)| sentence.to_owned());
        if let Some((name, _)) = turn.refusal {
            count(&mut self.refusals, name);
        }
        for (camera, refusal) in turn.absent {
            if let Some(counts) = self.drops.get_mut(*camera)
                && counts.len() < REASONS
            {
                count(counts, drop_name(refusal));
            }
        }
    }
}

/// Returns the name of a camera's refusal for the counts.
const fn drop_name(refusal: &CameraRefusal) -> &'static str {
    match refusal {
        CameraRefusal::Missing => "missing",
        CameraRefusal::Blank => "blank",
        CameraRefusal::Frozen => "frozen",
        CameraRefusal::Unsynchronised { .. } => "not synchronised",
    }
}

/// Describes a status in words.
fn condition(status: &Status) -> Value {
    let state = diagnosis::state(status.state);
    let fault = status.fault.map(|fault| {
        let text = diagnosis::fault(fault);
        json!({
            "number": fault.number(),
            "name": text.name.replace('_', " "),
            "cause": text.cause,
            "action": text.action,
        })
    });
    json!({
        "state": state.name,
        "meaning": state.meaning,
        "next": diagnosis::next_step(status),
        "fault": fault,
        "trust": diagnosis::trust(status.trust),
        "sight": diagnosis::sight(status.sight),
        "seen_ms": status.seen_ms,
        "motors": status.motors,
        "is_moving": status.state.is_moving(),
        "frames_used": status.frames_used,
        "frames_refused": status.frames_refused,
    })
}

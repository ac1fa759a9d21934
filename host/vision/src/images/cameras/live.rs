//! Frame sets of free-running cameras, one thread per camera.
//!
//! A camera thread waits for its camera, converts the image to grey and hands it to the
//! [matching](super::matching). A call for the next frame set returns the newest; older ones that
//! no call has taken are dropped and counted.
//!
//! The capture time is the [time stamp](super::stamp) less the delay of its camera. An image of
//! unknown time, or of a time before the start, counts as stale and is not used. Of cameras that a
//! station triggers it is the [trigger's instant](super::triggers).
//!
//! A camera that is lost or silent is left out as long as two others run: its images are
//! [`Image::missing`].

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::matching::{Counts, Matching, Set};
use super::triggers::{Count, Place, Triggers};
use crate::images::{FrameSet, Image};
use trinocular_rig::error::InputError;

/// Longest wait for a frame set.
pub const PATIENCE: Duration = Duration::from_secs(3);

/// Interval at which a waiting thread checks for the end.
const LOOK: Duration = Duration::from_millis(20);

/// Longest time between two checks that counts as waiting. A program that was suspended for longer
/// has waited for no image meanwhile.
const LONGEST_LOOK: Duration = Duration::from_millis(200);

/// Result of one wait for an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CameraEvent {
    /// Image with its time stamp.
    Image(Instant, Image),
    /// Image of unknown time.
    Stale,
    /// Image that the camera or its line has damaged.
    Damaged,
    /// Image of which packets are missing.
    Incomplete,
    /// No image yet.
    Nothing,
}

/// Camera that delivers images one by one.
pub trait Camera: Send + 'static {
    /// Returns the path of the device, for messages.
    fn path(&self) -> PathBuf;

    /// Waits for the next image, for a fraction of a second at most, so that the thread can end.
    ///
    /// # Errors
    /// [`InputError`] if the camera will deliver no more images.
    fn next_image(&mut self) -> Result<CameraEvent, InputError>;

    /// Returns the number of images that the driver has lost so far, as far as it is known.
    fn lost(&self) -> u64 {
        0
    }

    /// Returns true if no program can use the camera until this one has released it.
    fn needs_release(&self) -> bool {
        false
    }
}

impl Camera for Box<dyn Camera> {
    fn path(&self) -> PathBuf {
        self.as_ref().path()
    }

    fn next_image(&mut self) -> Result<CameraEvent, InputError> {
        self.as_mut().next_image()
    }

    fn lost(&self) -> u64 {
        self.as_ref().lost()
    }

    fn needs_release(&self) -> bool {
        self.as_ref().needs_release()
    }
}

/// Number of one camera's images, by their fate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Images handed to the matching.
    pub matching: Counts,
    /// Images of unknown time.
    pub stale: u64,
    /// Damaged images.
    pub damaged: u64,
    /// Images of which packets are missing.
    pub incomplete: u64,
    /// Images that the camera's driver lost.
    pub lost: u64,
    /// Triggers of which the camera has no image.
    pub missed: u64,
    /// Second images of a trigger.
    pub doubled: u64,
    /// Images of triggered cameras whose trigger is not certain.
    pub doubtful: u64,
}

impl Tally {
    /// Returns the reasons why images were not used, each with the number of images, without zeros.
    pub fn drops(&self) -> Vec<(&'static str, u64)> {
        let drops = [
            ("damaged", self.damaged),
            ("with missing packets", self.incomplete),
            ("lost by the driver", self.lost),
            ("missed triggers", self.missed),
            ("of unknown time", self.stale),
            ("out of order", self.matching.disordered),
            ("overtaken by newer images", self.matching.overtaken),
            ("second of a trigger", self.doubled),
            ("whose trigger is not certain", self.doubtful),
            ("without partners in time", self.matching.unmatched),
        ];
        drops.into_iter().filter(|(_, count)| *count > 0).collect()
    }
}

/// State that the threads share.
struct State {
    matching: Matching<Image>,
    /// Counts per camera, without those of the matching.
    tallies: Vec<Tally>,
    failed: Option<InputError>,
    /// Reasons why cameras are left out, not yet reported.
    losses: Vec<InputError>,
    /// Missed, doubled and doubtful images, not yet reported.
    anomalies: Vec<InputError>,
}

impl State {
    fn tallies(&self) -> Vec<Tally> {
        let counts = self.matching.counts().iter();
        let tallies = counts.zip(&self.tallies).map(|(matching, tally)| Tally {
            matching: *matching,
            ..*tally
        });
        tallies.collect()
    }
}

struct Shared {
    state: Mutex<State>,
    arrived: Condvar,
    ended: AtomicBool,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Running cameras: an iterator of frame sets that ends on the stop flag or after an error.
/// Dropping it ends the threads, each after its present [wait](Camera::next_image), and waits for
/// those whose camera [needs its release](Camera::needs_release).
pub struct LiveCameras {
    shared: Arc<Shared>,
    paths: Vec<PathBuf>,
    started: Instant,
    stop: Arc<AtomicBool>,
    patience: Duration,
    failed: bool,
    tell: Box<dyn FnMut(&InputError)>,
    tell_anomaly: Box<dyn FnMut(&InputError)>,
    /// Threads of cameras that need their release.
    releases: Vec<JoinHandle<()>>,
}

impl LiveCameras {
    /// Starts the cameras, which are in the rig's order. Images within `window` of each other
    /// belong to one instant; each was taken its camera's delay in `delays_us` before its time
    /// stamp, or after it if that is negative. A camera that `delays_us` does not reach has none.
    /// The frame sets end when `stop` is set. `tell` is called with the reason when a camera is
    /// lost while others carry on.
    ///
    /// # Errors
    /// [`InputError`] if a thread cannot be started.
    pub fn start<C: Camera>(
        cameras: Vec<C>,
        window: Duration,
        delays_us: &[i64],
        stop: Arc<AtomicBool>,
        tell: impl FnMut(&InputError) + 'static,
    ) -> Result<Self, InputError> {
        let started = Instant::now();
        let source = |camera: usize, _| TimeSource::Stamps {
            zero: later(started, delays_us.get(camera).copied().unwrap_or(0)),
        };
        Self::start_with(started, cameras, window, stop, tell, source)
    }

    /// Starts cameras that a station triggers, as [`LiveCameras::start`] does. The capture time of
    /// an image is the instant of its trigger, on the station's clock. `tell_anomaly` is called for
    /// each missed, doubled and doubtful image.
    ///
    /// # Errors
    /// As [`LiveCameras::start`].
    pub fn start_triggered<C: Camera>(
        cameras: Vec<C>,
        triggers: &Arc<Triggers>,
        stop: Arc<AtomicBool>,
        tell: impl FnMut(&InputError) + 'static,
        tell_anomaly: impl FnMut(&InputError) + 'static,
    ) -> Result<Self, InputError> {
        // Images of one trigger have the same time.
        let window = Duration::ZERO;
        triggers.attend(cameras.iter().map(Camera::path).collect());
        let source = |camera, path| TimeSource::Triggers {
            path,
            triggers: Arc::clone(triggers),
            count: Count::of(camera),
            events: 0,
        };
        let mut live = Self::start_with(Instant::now(), cameras, window, stop, tell, source)?;
        live.tell_anomaly = Box::new(tell_anomaly);
        Ok(live)
    }

    fn start_with<C: Camera>(
        started: Instant,
        cameras: Vec<C>,
        window: Duration,
        stop: Arc<AtomicBool>,
        tell: impl FnMut(&InputError) + 'static,
        source: impl Fn(usize, PathBuf) -> TimeSource,
    ) -> Result<Self, InputError> {
        let count = cameras.len();
        let shared = Arc::new(Shared {
            state: Mutex::new(State {
                matching: Matching::new(count, micros(window)),
                tallies: vec![Tally::default(); count],
                failed: None,
                losses: Vec::new(),
                anomalies: Vec::new(),
            }),
            arrived: Condvar::new(),
            ended: AtomicBool::new(false),
        });
        let mut live = Self {
            shared: Arc::clone(&shared),
            paths: cameras.iter().map(Camera::path).collect(),
            started,
            stop,
            patience: PATIENCE,
            failed: false,
            tell: Box::new(tell),
            tell_anomaly: Box::new(|_| ()),
            releases: Vec::new(),
        };
        for (index, camera) in cameras.into_iter().enumerate() {
            let shared = Arc::clone(&shared);
            let (path, needs_release) = (camera.path(), camera.needs_release());
            let source = source(index, path.clone());
            let run = move || attend(camera, index, source, &shared);
            let thread = std::thread::Builder::new()
                .name(format!("camera {index}"))
                .spawn(run)
                .map_err(|cause| InputError::io(&path, "start its thread", &cause))?;
            if needs_release {
                live.releases.push(thread);
            }
        }
        Ok(live)
    }

    /// Returns the time since the cameras were started, µs: the clock of the capture times.
    pub fn now_us(&self) -> u64 {
        micros(self.started.elapsed())
    }

    /// Returns the fate of the images, camera by camera.
    pub fn tallies(&self) -> Vec<Tally> {
        self.shared.state().tallies()
    }

    /// Returns a function that returns [`LiveCameras::tallies`], for another thread.
    pub fn counter(&self) -> impl Fn() -> Vec<Tally> + Send + Sync + 'static {
        let shared = Arc::clone(&self.shared);
        move || shared.state().tallies()
    }

    /// Returns the reason why no frame set came within [`PATIENCE`].
    fn silence(&self, state: &State, arrived_before: &[u64]) -> InputError {
        let waited = self.patience.as_secs();
        let silent = (state.matching.counts().iter())
            .zip(arrived_before)
            .enumerate()
            .filter(|(camera, (counts, before))| {
                counts.arrived == **before && state.matching.needs(*camera)
            })
            .min_by_key(|(_, (counts, _))| counts.arrived);
        let (path, reason) = match (silent, self.paths.first()) {
            (Some((camera, _)), _) => {
                let Tally {
                    stale,
                    damaged,
                    incomplete,
                    doubtful,
                    ..
                } = state.tallies[camera];
                let reason = match (stale + damaged, incomplete) {
                    (0, 0) if doubtful > 0 => format!(
                        "no image whose trigger is certain for {waited} s, of {doubtful} images \
                         so far: keep the exposure constant, or lower rate_hz"
                    ),
                    (0, 0) => format!("no image for {waited} s: is the camera still there?"),
                    (0, _) => format!(
                        "no whole image for {waited} s; so far {incomplete} had missing packets \
                         (set packet_size_bytes and packet_delay_us in the rig file, and the \
                         system's receive buffer)"
                    ),
                    _ => format!(
                        "no image that can be used for {waited} s; so far {damaged} were \
                         damaged, and {stale} came faster than they were fetched \
                         (lower --fps, or do less on this computer)"
                    ),
                };
                (self.paths[camera].clone(), reason)
            }
            (None, first) => {
                let apart_ms = state.matching.apart_us().unwrap_or(0) as f64 * 1e-3;
                (
                    first.cloned().unwrap_or_default(),
                    format!(
                        "no image within the window of the other cameras' for {waited} s, the \
                         latest are {apart_ms:.1} ms apart: trigger the cameras together, \
                         or raise --window"
                    ),
                )
            }
        };
        InputError::file(&path, reason)
    }

    fn wait(&self) -> Option<Result<Set<Image>, InputError>> {
        let mut state = self.shared.state();
        let arrived = |state: &State| -> Vec<u64> {
            let counts = state.matching.counts().iter();
            counts.map(|counts| counts.arrived).collect()
        };
        let before = arrived(&state);
        let (mut waited, mut looked) = (Duration::ZERO, Instant::now());
        loop {
            if self.stop.load(Relaxed) {
                return None;
            }
            if let Some(set) = state.matching.take_newest() {
                return Some(Ok(set));
            }
            if let Some(error) = state.failed.take() {
                return Some(Err(error));
            }
            let now = Instant::now();
            waited += now.duration_since(looked).min(LONGEST_LOOK);
            looked = now;
            if waited >= self.patience {
                return Some(Err(self.silence(&state, &before)));
            }
            let woken = self.shared.arrived.wait_timeout(state, LOOK);
            (state, _) = woken.unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// Returns the instant `by_us` after `at`, or before it if that is negative.
fn later(at: Instant, by_us: i64) -> Instant {
    let by = Duration::from_micros(by_us.unsigned_abs());
    let moved = match by_us < 0 {
        true => at.checked_sub(by),
        false => at.checked_add(by),
    };
    moved.unwrap_or(at)
}

/// Source of the capture times of one camera's images.
enum TimeSource {
    /// Time stamps, counted from `zero`.
    Stamps {
        /// Zero of the capture times.
        zero: Instant,
    },
    /// Triggers of a station.
    Triggers {
        /// Path of the camera, for messages.
        path: PathBuf,
        triggers: Arc<Triggers>,
        count: Count,
        /// Number of images so far, usable or not, without those that were lost.
        events: u64,
    },
}

impl TimeSource {
    /// Notes an event of the camera.
    fn note(&mut self, event: &CameraEvent) {
        if let Self::Triggers { events, .. } = self {
            *events += u64::from(!matches!(event, CameraEvent::Nothing));
        }
    }

    /// Returns the capture time of an image with this time stamp, µs, and counts what is wrong with
    /// it. `None` for an image that is not used. The camera has lost `lost` images so far.
    fn time_us(&mut self, at: Instant, lost: u64, shared: &Shared, index: usize) -> Option<u64> {
        let (path, place) = match self {
            Self::Stamps { zero } => {
                // An image that was taken before the start has no time, and is stale.
                let since = at.checked_duration_since(*zero);
                shared.state().tallies[index].stale += u64::from(since.is_none());
                return since.map(micros);
            }
            // Waits without the lock.
            Self::Triggers {
                path,
                triggers,
                count,
                events,
            } => (path, triggers.place(count, at, *events + lost)),
        };
        let mut state = shared.state();
        let tally = &mut state.tallies[index];
        let reason = match place {
            Place::Of { number, missed, .. } => {
                tally.missed += u64::from(missed);
                missed_images(number, missed)
            }
            Place::Miscounted { number, missed } => {
                tally.missed += u64::from(missed);
                tally.doubtful += 1;
                let doubt = format!(
                    "the image that fits trigger {number} is not used, because it may be of another"
                );
                let missed = missed_images(number, missed).into_iter();
                Some(missed.chain([doubt]).collect::<Vec<_>>().join("; "))
            }
            Place::Doubled { number } => {
                tally.doubled += 1;
                Some(format!("a second image of trigger {number}"))
            }
            Place::Doubtful => {
                tally.doubtful += 1;
                Some("an image whose trigger is not certain".to_owned())
            }
            Place::Before => None,
            Place::Unreported => {
                tally.stale += 1;
                None
            }
        };
        let anomaly = reason.map(|reason| InputError::file(path, reason));
        state.anomalies.extend(anomaly);
        match place {
            Place::Of { instant_us, .. } => Some(instant_us),
            _ => None,
        }
    }
}

/// Returns the words for the images that are missing right before that of a trigger.
fn missed_images(number: u32, missed: u32) -> Option<String> {
    let first = number - missed;
    match missed {
        0 => None,
        1 => Some(format!("no image of trigger {first}")),
        _ => Some(format!("no images of triggers {first} to {}", number - 1)),
    }
}

/// Runs one camera's thread.
fn attend<C: Camera>(mut camera: C, index: usize, mut source: TimeSource, shared: &Shared) {
    let mut is_lost = false;
    while !is_lost && !shared.ended.load(Relaxed) {
        let shot = camera.next_image();
        if let Ok(event) = &shot {
            source.note(event);
        }
        let time_us = match &shot {
            Ok(CameraEvent::Image(at, _)) => source.time_us(*at, camera.lost(), shared, index),
            _ => None,
        };
        let mut state = shared.state();
        state.tallies[index].lost = camera.lost();
        match shot {
            Ok(CameraEvent::Image(_, image)) => {
                if let Some(time_us) = time_us {
                    state.matching.push(index, time_us, image);
                }
            }
            Ok(CameraEvent::Stale) => state.tallies[index].stale += 1,
            Ok(CameraEvent::Damaged) => state.tallies[index].damaged += 1,
            Ok(CameraEvent::Incomplete) => state.tallies[index].incomplete += 1,
            Ok(CameraEvent::Nothing) => (),
            Err(error) => {
                if state.matching.leave_out(index) {
                    state.losses.push(error);
                } else {
                    state.failed.get_or_insert(error);
                }
                is_lost = true;
            }
        }
        drop(state);
        shared.arrived.notify_all();
    }
}

fn views(set: Set<Image>) -> Vec<Image> {
    let pictures = set.pictures.into_iter();
    let views = pictures.map(|picture| picture.map(|(_, image)| image));
    views.map(|view| view.unwrap_or(Image::missing())).collect()
}

fn micros(duration: Duration) -> u64 {
    u64::try_from(duration.as_micros()).unwrap_or(u64::MAX)
}

impl Iterator for LiveCameras {
    type Item = Result<FrameSet, InputError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let set = self.wait()?;
        let losses = std::mem::take(&mut self.shared.state().losses);
        losses.iter().for_each(&mut self.tell);
        let anomalies = std::mem::take(&mut self.shared.state().anomalies);
        anomalies.iter().for_each(&mut self.tell_anomaly);
        self.failed = set.is_err();
        Some(set.map(|set| FrameSet {
            time_us: set.time_us(),
            images: views(set),
        }))
    }
}

impl Drop for LiveCameras {
    fn drop(&mut self) {
        self.shared.ended.store(true, Relaxed);
        for thread in self.releases.drain(..) {
            // A thread that panicked has dropped its camera, too.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests;

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
use std::task::Poll;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

mod camera;
mod tally;
mod time_source;
mod wait;

pub use camera::{Camera, CameraEvent};
pub use tally::Tally;

use super::matching::{Matching, Set};
use super::triggers::{Count, Triggers};
use crate::images::{FrameSet, Image};
pub(super) use time_source::micros;
use time_source::{TimeSource, later};
use trinocular_rig::error::InputError;
use wait::Wait;

/// Longest wait for a frame set.
pub const PATIENCE: Duration = Duration::from_secs(3);

/// Interval at which a waiting thread checks for the end.
const LOOK: Duration = Duration::from_millis(20);

/// Longest time between two checks that counts as waiting. A program that was suspended for longer
/// has waited for no image meanwhile.
const LONGEST_LOOK: Duration = Duration::from_millis(200);

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
    /// Wait for the next frame set, if it has begun.
    wait: Option<Wait>,
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
        let source = |camera: usize| TimeSource::Stamps {
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
        let source = |camera| TimeSource::Triggers {
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
        source: impl Fn(usize) -> TimeSource,
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
            wait: None,
            failed: false,
            tell: Box::new(tell),
            tell_anomaly: Box::new(|_| ()),
            releases: Vec::new(),
        };
        for (index, camera) in cameras.into_iter().enumerate() {
            let shared = Arc::clone(&shared);
            let (path, needs_release) = (camera.path(), camera.needs_release());
            let source = source(index);
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

    /// Waits for a frame set, for `longest` at most.
    fn wait(&mut self, longest: Duration) -> Poll<Option<Result<Set<Image>, InputError>>> {
        let mut state = self.shared.state();
        let wait = self.wait.get_or_insert_with(|| Wait::begin(&state));
        let (mut waited, mut looked) = (Duration::ZERO, Instant::now());
        loop {
            if self.stop.load(Relaxed) {
                return Poll::Ready(None);
            }
            if let Some(set) = state.matching.take_newest() {
                return Poll::Ready(Some(Ok(set)));
            }
            if let Some(error) = state.failed.take() {
                return Poll::Ready(Some(Err(error)));
            }
            let now = Instant::now();
            let passed = now.duration_since(looked).min(LONGEST_LOOK);
            looked = now;
            waited += passed;
            wait.waited += passed;
            if wait.waited >= self.patience {
                let error = wait.silence(&state, &self.paths, self.patience);
                return Poll::Ready(Some(Err(error)));
            }
            if waited >= longest {
                return Poll::Pending;
            }
            let woken = self.shared.arrived.wait_timeout(state, LOOK);
            (state, _) = woken.unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Waits for the next frame set as the iterator does, but for `longest` at most; then it is
    /// [`Poll::Pending`], and the next call waits on. The time between the calls counts for no
    /// camera that is silent.
    pub fn next_within(&mut self, longest: Duration) -> Poll<Option<Result<FrameSet, InputError>>> {
        if self.failed {
            return Poll::Ready(None);
        }
        let set = self.wait(longest);
        let (losses, anomalies) = {
            let mut state = self.shared.state();
            let anomalies = std::mem::take(&mut state.anomalies);
            (std::mem::take(&mut state.losses), anomalies)
        };
        losses.iter().for_each(&mut self.tell);
        anomalies.iter().for_each(&mut self.tell_anomaly);
        if set.is_ready() {
            self.wait = None;
        }
        self.failed = matches!(set, Poll::Ready(Some(Err(_))));
        set.map_ok(|set| FrameSet {
            time_us: set.time_us(),
            images: views(set),
        })
    }

    /// Takes capture times that begin anew, as those of a station that has restarted: the images
    /// that wait for others are dropped, and the wait for a silent camera begins anew.
    pub fn begin_times_anew(&mut self) {
        self.shared.state().matching.begin_anew();
        self.wait = None;
    }
}

/// Runs one camera's thread.
fn attend<C: Camera>(mut camera: C, index: usize, mut source: TimeSource, shared: &Shared) {
    let path = camera.path();
    let mut is_lost = false;
    while !is_lost && !shared.ended.load(Relaxed) {
        let shot = camera.next_image();
        if let Ok(event) = &shot {
            source.note(event);
        }
        // Without the lock: an image waits for the report of its trigger.
        let placed = match &shot {
            Ok(CameraEvent::Image(at, _)) => Some(source.place(*at, camera.lost())),
            _ => None,
        };
        let mut state = shared.state();
        state.tallies[index].lost = camera.lost();
        if let Some(anomaly) = placed.and_then(|placed| placed.count(&mut state.tallies[index])) {
            state.anomalies.push(InputError::file(&path, anomaly));
        }
        match shot {
            Ok(CameraEvent::Image(_, image)) => {
                if let Some(time_us) = placed.and_then(|placed| placed.time_us()) {
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

impl Iterator for LiveCameras {
    type Item = Result<FrameSet, InputError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Poll::Ready(set) = self.next_within(self.patience) {
                return set;
            }
        }
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

//! Captures of cameras that run by themselves, each in a thread of its own.
//!
//! A camera thread does nothing but wait for its camera, turn the picture grey and hand it to the
//! [matching](super::matching). Whoever asks for the next capture gets the newest; older ones that
//! nobody had time for are dropped and counted.
//!
//! *When a picture was taken* is told from the [moment](super::stamp) that the camera gives it,
//! less a delay that is the same for all. A picture whose moment is not known, or lies before the
//! start, is counted as stale and not used.
//!
//! A camera that is lost, or falls silent, is left out as long as two are left: its views are
//! [`Image::missing`].

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::matching::{Counts, Matching, Set};
use crate::error::InputError;
use crate::images::{FrameSet, Image};

/// How long a capture may be awaited.
pub const PATIENCE: Duration = Duration::from_secs(3);

/// How often somebody who waits looks whether he is to end.
const LOOK: Duration = Duration::from_millis(20);

/// What a camera gave.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Shot {
    /// A picture, with its moment.
    Picture(Instant, Image),
    /// A picture that came at an unknown time.
    Stale,
    /// A picture that the camera or its line has spoilt.
    Damaged,
    /// None yet.
    Nothing,
}

/// A camera, waiting for its next picture.
pub trait Camera: Send + 'static {
    /// Where it is, for messages.
    fn path(&self) -> PathBuf;

    /// Waits for the next picture, but no longer than one who wants to end can wait.
    ///
    /// # Errors
    /// If there will be no more.
    fn shoot(&mut self) -> Result<Shot, InputError>;

    /// Pictures so far that the camera took but could not hand over, as far as it knows.
    fn lost(&self) -> u64 {
        0
    }
}

/// What became of one camera's pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Those that could be matched.
    pub matching: Counts,
    /// That came at an unknown time.
    pub stale: u64,
    /// That were spoilt.
    pub damaged: u64,
    /// That the camera's driver lost.
    pub lost: u64,
}

/// What the threads share.
struct State {
    matching: Matching<Image>,
    /// Without what the matching counts.
    tallies: Vec<Tally>,
    failed: Option<InputError>,
    /// Why cameras are left out, to be told.
    losses: Vec<InputError>,
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

/// Cameras that run. An iterator of captures: it ends when it is told to stop, or after an error.
/// Dropping it ends the threads, each as soon as its camera has [shot](Camera::shoot) or seen that
/// there is nothing.
pub struct Live {
    shared: Arc<Shared>,
    paths: Vec<PathBuf>,
    started: Instant,
    stop: Arc<AtomicBool>,
    patience: Duration,
    failed: bool,
    tell: Box<dyn FnMut(&InputError)>,
}

impl Live {
    /// Starts the cameras, which are in the rig's order. Pictures within `window` of each other are
    /// of one time; each was taken `delay_us` before its moment, or after it if that is negative.
    /// The captures end when `stop` is set. `tell` hears why a camera is lost while others carry
    /// on.
    ///
    /// # Errors
    /// If a thread cannot be started.
    pub fn start<C: Camera>(
        cameras: Vec<C>,
        window: Duration,
        delay_us: i64,
        stop: Arc<AtomicBool>,
        tell: impl FnMut(&InputError) + 'static,
    ) -> Result<Self, InputError> {
        let count = cameras.len();
        let started = Instant::now();
        let delay = Duration::from_micros(delay_us.unsigned_abs());
        let zero = match delay_us < 0 {
            true => started.checked_sub(delay),
            false => started.checked_add(delay),
        };
        let zero = zero.unwrap_or(started);
        let shared = Arc::new(Shared {
            state: Mutex::new(State {
                matching: Matching::new(count, micros(window)),
                tallies: vec![Tally::default(); count],
                failed: None,
                losses: Vec::new(),
            }),
            arrived: Condvar::new(),
            ended: AtomicBool::new(false),
        });
        let live = Self {
            shared: Arc::clone(&shared),
            paths: cameras.iter().map(Camera::path).collect(),
            started,
            stop,
            patience: PATIENCE,
            failed: false,
            tell: Box::new(tell),
        };
        for (index, camera) in cameras.into_iter().enumerate() {
            let shared = Arc::clone(&shared);
            let path = camera.path();
            let run = move || attend(camera, index, zero, &shared);
            std::thread::Builder::new()
                .name(format!("camera {index}"))
                .spawn(run)
                .map_err(|cause| InputError::io(&path, "start its thread", &cause))?;
        }
        Ok(live)
    }

    /// Time since the cameras were started, µs: the clock of the captures.
    pub fn now_us(&self) -> u64 {
        micros(self.started.elapsed())
    }

    /// What became of the pictures, camera by camera.
    pub fn tallies(&self) -> Vec<Tally> {
        let state = self.shared.state();
        let counts = state.matching.counts().iter();
        counts
            .zip(&state.tallies)
            .map(|(matching, tally)| Tally {
                matching: *matching,
                ..*tally
            })
            .collect()
    }

    /// Why no capture came for so long.
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
                let Tally { stale, damaged, .. } = state.tallies[camera];
                let reason = match stale + damaged {
                    0 => format!("no picture for {waited} s: is the camera still there?"),
                    _ => format!(
                        "no picture that can be used for {waited} s; so far {damaged} were damaged, and {stale} came faster than they were fetched (lower \
                         --fps, or do less on this computer)"
                    ),
                };
                (self.paths[camera].clone(), reason)
            }
            (None, first) => {
                let apart_ms = state.matching.apart_us().unwrap_or(0) as f64 * 1e-3;
                (
                    first.cloned().unwrap_or_default(),
                    format!(
                        "no picture within the window of the other cameras' for {waited} s, the latest are {apart_ms:.1} ms apart: trigger the cameras \
                         together, or raise --window"
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
        let end = Instant::now() + self.patience;
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
            if Instant::now() >= end {
                return Some(Err(self.silence(&state, &before)));
            }
            let waited = self.shared.arrived.wait_timeout(state, LOOK);
            (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// A camera's thread. Its pictures' times count from `zero`.
fn attend<C: Camera>(mut camera: C, index: usize, zero: Instant, shared: &Shared) {
    let mut is_lost = false;
    while !is_lost && !shared.ended.load(Relaxed) {
        let shot = camera.shoot();
        let mut state = shared.state();
        state.tallies[index].lost = camera.lost();
        match shot {
            // What was taken before the start is of no use, and has no time.
            Ok(Shot::Picture(at, image)) => match at.checked_duration_since(zero) {
                Some(since) => state.matching.push(index, micros(since), image),
                None => state.tallies[index].stale += 1,
            },
            Ok(Shot::Stale) => state.tallies[index].stale += 1,
            Ok(Shot::Damaged) => state.tallies[index].damaged += 1,
            Ok(Shot::Nothing) => (),
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

impl Iterator for Live {
    type Item = Result<FrameSet, InputError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let set = self.wait()?;
        let losses = std::mem::take(&mut self.shared.state().losses);
        losses.iter().for_each(&mut self.tell);
        self.failed = set.is_err();
        Some(set.map(|set| FrameSet {
            time_us: set.time_us(),
            images: views(set),
        }))
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.shared.ended.store(true, Relaxed);
    }
}

#[cfg(test)]
mod tests;

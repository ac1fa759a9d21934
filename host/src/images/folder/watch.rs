//! A folder of captures that grows while it is read.
//!
//! Nothing tells a reader that a writer has finished a file, so it is told from what does not happen: a file counts as written when its size and its time
//! of change have stayed for [`SETTLE`]. What cannot be read even then, because its writer paused, is tried again until it has stayed for
//! [`PATIENCE`]; then it is an error. PNG and PNM files that are cut off are always noticed, JPEG files not always: a program that may pause in the
//! middle of one should write it under a hidden name (`.000001.jpg`) and rename it.
//!
//! Captures come in the order of their names. One that lacks a camera's file holds up those behind it for [`PATIENCE`]; it comes without that view when a
//! later one is whole, or the camera, which has sent pictures before, has been silent for as long. One of a single view is passed over, and told. So is
//! one whose files come after a later capture was given.
//!
//! The folder is listed twenty times a second. That works on file systems that report no changes, such as those on a network.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant, SystemTime};

use super::{list, numbers_padded, read};
use crate::error::InputError;
use crate::images::{Capture, Image};

/// So long a file must stay as it is.
pub const SETTLE: Duration = Duration::from_millis(200);

/// So long a missing or unreadable file is waited for, after the capture's last change.
pub const PATIENCE: Duration = Duration::from_secs(2);

/// Between two looks.
const LOOK: Duration = Duration::from_millis(50);

/// How a folder is watched.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The time between frames, µs: captures have no other times.
    pub period_us: u64,
    /// The end comes when nothing has changed for so long; without it only when `stop` is set.
    pub idle: Option<Duration>,
    /// Set to end it.
    pub stop: Arc<AtomicBool>,
}

/// A file as it was last seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Seen {
    size: u64,
    modified: Option<SystemTime>,
    since: Instant,
}

/// The name with its numbers padded, and the name: captures come in this order.
type Key = (String, String);

/// A folder that is watched: an iterator of captures, which waits for the next one.
pub struct Watch<T> {
    /// One folder per camera, in the rig's order.
    cameras: Vec<PathBuf>,
    size_px: [u32; 2],
    settings: Settings,
    /// Captures that have not been given: per camera its file, if it is there.
    waiting: BTreeMap<Key, Vec<Option<Seen>>>,
    /// Those that have been given or passed over.
    done: BTreeSet<Key>,
    given: u64,
    changed: Instant,
    /// Per camera: when its last file came or grew.
    heard: Vec<Option<Instant>>,
    over: bool,
    tell: T,
}

/// What a look has found.
#[derive(Debug)]
enum Look {
    Capture(Capture),
    Nothing,
    Over,
}

impl<T: FnMut(&InputError)> Watch<T> {
    /// Watches `dir`, whose subfolders are, or will be, `names`, one per camera in the rig's order. `size_px` (width, height) is what every image must have.
    /// `tell` hears of captures that are passed over.
    ///
    /// # Errors
    /// If there is no such folder.
    pub fn open(
        dir: &Path,
        names: &[String],
        size_px: [u32; 2],
        settings: Settings,
        tell: T,
    ) -> Result<Self, InputError> {
        if !dir.is_dir() {
            return Err(InputError::file(dir, "no such folder"));
        }
        Ok(Self {
            cameras: names.iter().map(|name| dir.join(name)).collect(),
            size_px,
            settings,
            waiting: BTreeMap::new(),
            done: BTreeSet::new(),
            given: 0,
            changed: Instant::now(),
            heard: vec![None; names.len()],
            over: false,
            tell,
        })
    }

    /// Looks once. `now` never goes back.
    fn look(&mut self, now: Instant) -> Result<Look, InputError> {
        self.list(now)?;
        let is_idle = self.is_idle(now);
        while let Some((key, files)) = self.waiting.first_key_value() {
            let key = key.clone();
            let changed = files.iter().flatten().map(|seen| seen.since).max();
            let quiet = now.duration_since(changed.unwrap_or(now));
            let has_waited = quiet >= PATIENCE;
            let is_there: Vec<bool> = files.iter().map(Option::is_some).collect();
            if let Some(missing) = is_there.iter().position(|there| !there) {
                let is_final =
                    has_waited && (self.is_overtaken() || self.are_silent(&is_there, now));
                if !is_final && !is_idle {
                    break;
                }
                if is_there.iter().filter(|there| **there).count() < 2 {
                    let file = self.cameras[missing].join(&key.1);
                    let reason =
                        "never came, but another camera has a file of this name: passed over";
                    (self.tell)(&InputError::file(&file, reason));
                    self.done(key);
                    continue;
                }
            } else if quiet < SETTLE {
                break;
            }
            match self.read(&key.1, &is_there) {
                Ok(capture) => {
                    self.done(key);
                    self.given += 1;
                    return Ok(Look::Capture(capture));
                }
                Err(error) if has_waited || is_idle => return Err(error),
                Err(_) => break,
            }
        }
        Ok(match is_idle && self.waiting.is_empty() {
            true => Look::Over,
            false => Look::Nothing,
        })
    }

    fn is_idle(&self, now: Instant) -> bool {
        let quiet = now.duration_since(self.changed);
        self.settings.idle.is_some_and(|idle| quiet >= idle)
    }

    /// Whether a whole capture waits.
    fn is_overtaken(&self) -> bool {
        let mut waiting = self.waiting.values();
        waiting.any(|files| files.iter().all(Option::is_some))
    }

    /// Whether the cameras whose file is not there have sent files before, but none for a while.
    fn are_silent(&self, is_there: &[bool], now: Instant) -> bool {
        let mut cameras = self.heard.iter().zip(is_there);
        cameras.all(|(heard, there)| {
            *there || heard.is_some_and(|heard| now.duration_since(heard) >= PATIENCE)
        })
    }

    fn done(&mut self, key: Key) {
        self.waiting.remove(&key);
        self.done.insert(key);
    }

    /// Brings what waits up to date.
    fn list(&mut self, now: Instant) -> Result<(), InputError> {
        let mut waiting: BTreeMap<Key, Vec<Option<Seen>>> = BTreeMap::new();
        let mut has_changed = false;
        for (index, camera) in self.cameras.iter().enumerate() {
            // The writer may not have made it yet.
            let names = if camera.is_dir() {
                list(camera)?
            } else {
                BTreeSet::new()
            };
            for name in names {
                let key = (numbers_padded(&name), name);
                if self.done.contains(&key) {
                    continue;
                }
                if self.done.last().is_some_and(|last| key < *last) {
                    let reason = "came after a later capture was taken: passed over";
                    (self.tell)(&InputError::file(&camera.join(&key.1), reason));
                    self.done.insert(key);
                    continue;
                }
                // A file that is gone again was not meant for us.
                let Ok(about) = fs::metadata(camera.join(&key.1)) else {
                    continue;
                };
                let before = self.waiting.get(&key).and_then(|files| files[index]);
                let (size, modified) = (about.len(), about.modified().ok());
                let seen = match before {
                    Some(seen) if seen.size == size && seen.modified == modified => seen,
                    _ => {
                        has_changed = true;
                        self.heard[index] = Some(now);
                        Seen {
                            size,
                            modified,
                            since: now,
                        }
                    }
                };
                let none = || vec![None; self.cameras.len()];
                waiting.entry(key).or_insert_with(none)[index] = Some(seen);
            }
        }
        self.waiting = waiting;
        if has_changed {
            self.changed = now;
        }
        Ok(())
    }

    /// The capture of this name, from the cameras whose file is there.
    fn read(&self, name: &str, is_there: &[bool]) -> Result<Capture, InputError> {
        let cameras = self.cameras.iter().zip(is_there);
        let views = cameras.map(|(camera, there)| match there {
            true => read(&camera.join(name), self.size_px),
            false => Ok(Image::missing()),
        });
        Ok(Capture {
            time_us: self.settings.period_us.saturating_mul(self.given),
            views: views.collect::<Result<_, _>>()?,
        })
    }
}

impl<T: FnMut(&InputError)> Iterator for Watch<T> {
    type Item = Result<Capture, InputError>;

    fn next(&mut self) -> Option<Self::Item> {
        // Time that somebody took for the last capture is no time without captures.
        self.changed = Instant::now();
        while !self.over && !self.settings.stop.load(Relaxed) {
            match self.look(Instant::now()) {
                Ok(Look::Capture(capture)) => return Some(Ok(capture)),
                Ok(Look::Nothing) => std::thread::sleep(LOOK),
                Ok(Look::Over) => self.over = true,
                Err(error) => {
                    self.over = true;
                    return Some(Err(error));
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests;

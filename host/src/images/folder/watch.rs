//! A folder of captures that grows while it is read.
//!
//! Nothing tells a reader that a writer has finished a file, so it is told from what does not
//! happen: a file counts as written when its size and its time of change have stayed for
//! [`SETTLE`], and are still the same when it has been read. What cannot be read even then, because
//! its writer paused, is tried again until it has stayed for [`PATIENCE`]; then it is an error, and
//! the next capture's turn. Files that are cut off are always noticed
//! ([`decode`](crate::images::decode)); a program that may pause for longer in the middle of one
//! should write it under a hidden name (`.000001.jpg`) and rename it.
//!
//! Captures come in the order of their names. One that lacks a camera's file holds up those behind
//! it for [`PATIENCE`]; it comes without that view when a later one is whole, or the camera, which
//! has sent pictures before, has been silent for as long. A camera that has sent none is told,
//! once, and waited for. A capture of a single view is passed over, and told. So is one whose files
//! come after a later capture was given.
//!
//! The folder is listed at most twenty times a second. That works on file systems that report no
//! changes, such as those on a network. What is kept in memory are the names of the files that are
//! there; a capture's files may be removed as soon as it has been given.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant, SystemTime};

use super::{list, numbers_padded, read};
use crate::error::InputError;
use crate::images::{FrameSet, Image};

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

impl Seen {
    /// As it is now; `None` if it is not there.
    fn now(file: &Path, since: Instant) -> Option<Self> {
        // A link that leads nowhere is there, and cannot be read.
        let about = fs::metadata(file)
            .or_else(|_| fs::symlink_metadata(file))
            .ok()?;
        let (size, modified) = (about.len(), about.modified().ok());
        Some(Self {
            size,
            modified,
            since,
        })
    }

    /// Whether nothing was written in between.
    fn is_same(&self, other: &Self) -> bool {
        (self.size, self.modified) == (other.size, other.modified)
    }
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
    /// The names of those that have been given or passed over, and are still there.
    done: HashSet<String>,
    /// The last of those that were.
    last: Option<Key>,
    /// Captures that had their time: given, or not readable.
    taken: u64,
    /// When [`list`](Self::list) was last done with.
    listed: Option<Instant>,
    changed: Instant,
    /// Per camera: when its last file came or grew.
    heard: Vec<Option<Instant>>,
    /// Whether cameras that were never heard have been told.
    has_told_unheard: bool,
    over: bool,
    tell: T,
}

/// What a look has found.
#[derive(Debug)]
enum Look {
    FrameSet(FrameSet),
    Unreadable(InputError),
    Nothing,
    Over,
}

impl<T: FnMut(&InputError)> Watch<T> {
    /// Watches `dir`, whose subfolders are, or will be, `names`, one per camera in the rig's order.
    /// `size_px` (width, height) is what every image must have. `tell` hears of captures that are
    /// passed over.
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
            done: HashSet::new(),
            last: None,
            taken: 0,
            listed: None,
            changed: Instant::now(),
            heard: vec![None; names.len()],
            has_told_unheard: false,
            over: false,
            tell,
        })
    }

    /// Looks once. `now` never goes back.
    fn look(&mut self, now: Instant) -> Result<Look, InputError> {
        self.list(now)?;
        let is_idle = self.is_idle(now);
        Ok(match self.ready(now, is_idle) {
            Look::Nothing if is_idle && self.waiting.is_empty() => Look::Over,
            look => look,
        })
    }

    /// The next capture of those that were listed. `is_idle`: no more files will come.
    fn ready(&mut self, now: Instant, is_idle: bool) -> Look {
        while let Some((key, files)) = self.waiting.first_key_value() {
            let (key, files) = (key.clone(), files.clone());
            let changed = files.iter().flatten().map(|seen| seen.since).max();
            let quiet = now.duration_since(changed.unwrap_or(now));
            let has_waited = quiet >= PATIENCE;
            if let Some(missing) = files.iter().position(Option::is_none) {
                let is_final = has_waited && (self.is_overtaken() || self.are_silent(&files, now));
                if !is_final && !is_idle {
                    if has_waited {
                        self.tell_unheard();
                    }
                    break;
                }
                if files.iter().flatten().count() < 2 {
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
            let capture = self.read(&key.1, &files);
            if self.has_changed(&key.1, &files, capture.is_ok()) {
                break;
            }
            match capture {
                Ok(capture) => {
                    self.done(key);
                    self.taken += 1;
                    return Look::FrameSet(capture);
                }
                Err(error) if has_waited || is_idle => {
                    self.done(key);
                    self.taken += 1;
                    return Look::Unreadable(error);
                }
                Err(_) => break,
            }
        }
        Look::Nothing
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
    fn are_silent(&self, files: &[Option<Seen>], now: Instant) -> bool {
        let mut cameras = self.heard.iter().zip(files);
        cameras.all(|(heard, seen)| {
            seen.is_some() || heard.is_some_and(|heard| now.duration_since(heard) >= PATIENCE)
        })
    }

    /// Says which cameras the captures wait for, once.
    fn tell_unheard(&mut self) {
        if std::mem::replace(&mut self.has_told_unheard, true) {
            return;
        }
        for (camera, heard) in self.cameras.iter().zip(&self.heard) {
            if heard.is_none() {
                let reason = "no image yet, but another camera has some: waiting for the first";
                (self.tell)(&InputError::file(camera, reason));
            }
        }
    }

    fn done(&mut self, key: Key) {
        self.waiting.remove(&key);
        self.done.insert(key.1.clone());
        self.last = Some(key);
    }

    /// Whether a file was written to since it was listed, or, if it `was_read` not, is gone.
    fn has_changed(&self, name: &str, files: &[Option<Seen>], was_read: bool) -> bool {
        let mut files = self.cameras.iter().zip(files);
        files.any(|(camera, seen)| {
            seen.is_some_and(|seen| match Seen::now(&camera.join(name), seen.since) {
                Some(now) => !now.is_same(&seen),
                None => !was_read,
            })
        })
    }

    /// Brings what waits up to date.
    fn list(&mut self, now: Instant) -> Result<(), InputError> {
        let mut waiting: BTreeMap<Key, Vec<Option<Seen>>> = BTreeMap::new();
        let mut done = HashSet::new();
        let mut has_changed = false;
        for (index, camera) in self.cameras.iter().enumerate() {
            // The writer may not have made it yet.
            let names = if camera.is_dir() {
                list(camera)?
            } else {
                BTreeSet::new()
            };
            for name in names {
                if self.done.contains(&name) {
                    done.insert(name);
                    continue;
                }
                let key = (numbers_padded(&name), name);
                if self.last.as_ref().is_some_and(|last| key <= *last) {
                    let reason = "came after a later capture was taken: passed over";
                    (self.tell)(&InputError::file(&camera.join(&key.1), reason));
                    self.done.insert(key.1.clone());
                    done.insert(key.1);
                    continue;
                }
                // A file that is gone again was not meant for us.
                let Some(seen) = Seen::now(&camera.join(&key.1), now) else {
                    continue;
                };
                let before = self.waiting.get(&key).and_then(|files| files[index]);
                let seen = match before {
                    Some(before) if before.is_same(&seen) => before,
                    _ => {
                        has_changed = true;
                        self.heard[index] = Some(now);
                        seen
                    }
                };
                let none = || vec![None; self.cameras.len()];
                waiting.entry(key).or_insert_with(none)[index] = Some(seen);
            }
        }
        self.waiting = waiting;
        self.done = done;
        if has_changed {
            self.changed = now;
        }
        Ok(())
    }

    /// The capture of this name, from the cameras whose file is there.
    fn read(&self, name: &str, files: &[Option<Seen>]) -> Result<FrameSet, InputError> {
        let cameras = self.cameras.iter().zip(files);
        let views = cameras.map(|(camera, seen)| match seen {
            Some(_) => read(&camera.join(name), self.size_px),
            None => Ok(Image::missing()),
        });
        Ok(FrameSet {
            time_us: self.settings.period_us.saturating_mul(self.taken),
            images: views.collect::<Result<_, _>>()?,
        })
    }
}

impl<T: FnMut(&InputError)> Iterator for Watch<T> {
    type Item = Result<FrameSet, InputError>;

    fn next(&mut self) -> Option<Self::Item> {
        // Time that somebody took for the last capture is no time without captures.
        self.changed = Instant::now();
        while !self.over && !self.settings.stop.load(Relaxed) {
            let now = Instant::now();
            // A long list takes long: not for each of the captures that wait in it.
            let is_listed = self.listed.is_some_and(|listed| now - listed < LOOK);
            let look = if is_listed {
                Ok(self.ready(now, false))
            } else {
                let look = self.look(now);
                self.listed = Some(Instant::now());
                look
            };
            match look {
                Ok(Look::FrameSet(capture)) => return Some(Ok(capture)),
                Ok(Look::Unreadable(error)) => return Some(Err(error)),
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

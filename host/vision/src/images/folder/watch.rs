//! Folder of frame sets that grows while it is read.
//!
//! No event marks the end of writing a file, so a file counts as written when its size and its time
//! of change have been constant for [`SETTLE`], and are the same after reading it. A file that
//! cannot be read then, because its writer paused, is read again until it has been constant for
//! [`PATIENCE`]; then it is an error, and the next frame set follows. Files that are cut off are
//! always noticed ([`decode`](crate::images::decode)). A program that may pause for longer while
//! writing should write under a hidden name (`.000001.jpg`) and rename the file.
//!
//! Frame sets come in the order of their names. A frame set without a camera's file holds up the
//! later ones for [`PATIENCE`]. It comes without that image when a later one is whole, or when the
//! camera, which has sent images before, has been silent for as long. A camera that has sent no
//! image is reported once, and the frame sets wait for it. A frame set of a single image is skipped
//! with a report. So is one whose files come after a later frame set was returned.
//!
//! Stacks and videos are refused by name, because a file that still grows has no last image.
//!
//! The folder is listed at most twenty times a second. This works on file systems that report no
//! changes, such as network file systems. Memory holds only the names of existing files; a frame
//! set's files may be removed as soon as it has been returned.

use std::collections::{BTreeMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant, SystemTime};

use super::{Listing, bits_in_use, listing, numbers_padded, read_deep};
use crate::images::decode::Picture;
use crate::images::series::layout;
use crate::images::{FrameSet, Image};
use trinocular_rig::error::InputError;

/// Time for which a file must be unchanged before it is read.
pub const SETTLE: Duration = Duration::from_millis(200);

/// Longest wait for a missing or unreadable file, from the frame set's last change.
pub const PATIENCE: Duration = Duration::from_secs(2);

/// Time between two listings.
const LOOK: Duration = Duration::from_millis(50);

/// Reason why a stack or video is not watched.
const WHOLE: &str = "a stack or video of a camera: a watched folder is read image by image, each in a \
                     file of its own in the camera's folder; --images reads stacks and videos";

/// Settings of a watched folder.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Time between frame sets, µs; files have no capture time of their own.
    pub period_us: u64,
    /// Time without changes after which the frame sets end; without it they end only when `stop` is
    /// set.
    pub idle: Option<Duration>,
    /// Flag that ends the frame sets when set.
    pub stop: Arc<AtomicBool>,
}

/// State of a file at its last listing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Seen {
    size: u64,
    modified: Option<SystemTime>,
    since: Instant,
}

impl Seen {
    /// Reads the state of a file; `None` if it does not exist.
    fn now(file: &Path, since: Instant) -> Option<Self> {
        // A dangling link exists and cannot be read.
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

    /// Returns true if nothing was written between the two states.
    fn is_same(&self, other: &Self) -> bool {
        (self.size, self.modified) == (other.size, other.modified)
    }
}

/// Name with its numbers padded, and the name: the order of the frame sets.
type Key = (String, String);

/// Watched folder: an iterator of frame sets, which waits for the next one.
///
/// ```no_run
/// use std::path::Path;
/// use std::sync::Arc;
/// use std::sync::atomic::AtomicBool;
/// use trinocular_vision::images::folder::watch::{Settings, Watch};
///
/// let stop = Arc::new(AtomicBool::new(false));
/// let settings = Settings { period_us: 33_333, idle: None, stop };
/// let names = ["left", "right"].map(String::from);
/// let skipped = |skipped: &trinocular_rig::error::InputError| eprintln!("{skipped}");
/// for frame_set in Watch::open(Path::new("captures"), &names, [640, 480], settings, skipped)? {
///     println!("{} us", frame_set?.time_us);
/// }
/// # Ok::<(), trinocular_rig::error::InputError>(())
/// ```
pub struct Watch<T> {
    dir: PathBuf,
    names: Vec<String>,
    /// Folder of each camera, in the rig's order.
    cameras: Vec<PathBuf>,
    size_px: [u32; 2],
    settings: Settings,
    /// Frame sets that have not been returned: the file of each camera, if it exists.
    waiting: BTreeMap<Key, Vec<Option<Seen>>>,
    /// Names of returned and skipped frame sets whose files still exist.
    done: HashSet<String>,
    /// Last frame set that was returned or skipped.
    last: Option<Key>,
    /// Number of frame sets that were returned or not readable.
    taken: u64,
    /// Time of the last [`list`](Self::list).
    listed: Option<Instant>,
    changed: Instant,
    /// Time of each camera's last new or grown file.
    heard: Vec<Option<Instant>>,
    /// True after the report of cameras that never sent an image.
    has_told_unheard: bool,
    /// Per camera: true after the report of images in formats that are not read.
    has_told_unread: Vec<bool>,
    /// Most bits in use so far.
    depth_bits: u32,
    over: bool,
    tell: T,
}

/// Result of one look at the folder.
#[derive(Debug)]
enum Look {
    FrameSet(FrameSet),
    Unreadable(InputError),
    Nothing,
    Over,
}

impl<T: FnMut(&InputError)> Watch<T> {
    /// Watches `dir`, whose subfolders, existing or not yet, are `names`, one per camera in the
    /// rig's order. `size_px` (width, height) is the size that every image must have. `tell` is
    /// called with each skipped frame set, and once per camera with images that are not read.
    ///
    /// # Errors
    /// [`InputError`] if there is no such folder.
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
            dir: dir.to_owned(),
            names: names.to_vec(),
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
            has_told_unread: vec![false; names.len()],
            depth_bits: 8,
            over: false,
            tell,
        })
    }

    /// Looks at the folder once. `now` never goes back.
    fn look(&mut self, now: Instant) -> Result<Look, InputError> {
        self.list(now)?;
        let is_idle = self.is_idle(now);
        Ok(match self.ready(now, is_idle) {
            Look::Nothing if is_idle && self.waiting.is_empty() => Look::Over,
            look => look,
        })
    }

    /// Returns the next of the listed frame sets. `is_idle` is true if no more files will come.
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
                    let reason = "never came, but another camera has a file of this name; the frame \
                         set is skipped";
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

    /// Returns true if a whole frame set waits.
    fn is_overtaken(&self) -> bool {
        let mut waiting = self.waiting.values();
        waiting.any(|files| files.iter().all(Option::is_some))
    }

    /// Returns true if the cameras without a file have sent files before, but none for
    /// [`PATIENCE`].
    fn are_silent(&self, files: &[Option<Seen>], now: Instant) -> bool {
        let mut cameras = self.heard.iter().zip(files);
        cameras.all(|(heard, seen)| {
            seen.is_some() || heard.is_some_and(|heard| now.duration_since(heard) >= PATIENCE)
        })
    }

    /// Reports, once, the cameras that the frame sets wait for.
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

    /// Returns true if a file was written to since it was listed, or is gone without having been
    /// read (`was_read` is false).
    fn has_changed(&self, name: &str, files: &[Option<Seen>], was_read: bool) -> bool {
        let mut files = self.cameras.iter().zip(files);
        files.any(|(camera, seen)| {
            seen.is_some_and(|seen| match Seen::now(&camera.join(name), seen.since) {
                Some(now) => !now.is_same(&seen),
                None => !was_read,
            })
        })
    }

    /// Updates the waiting frame sets from the folder.
    fn list(&mut self, now: Instant) -> Result<(), InputError> {
        // Once single images come, the program that writes them has shown its form.
        if self.taken == 0
            && let Some(file) = layout::stack_or_video(&self.dir, &self.names)?
        {
            return Err(InputError::file(&file, WHOLE));
        }
        let mut waiting: BTreeMap<Key, Vec<Option<Seen>>> = BTreeMap::new();
        let mut done = HashSet::new();
        let mut has_changed = false;
        for (index, camera) in self.cameras.iter().enumerate() {
            // The writer may not have made the folder yet.
            let listing = match camera.is_dir() {
                true => listing(camera)?,
                false => Listing::default(),
            };
            if !self.has_told_unread[index]
                && let Some(warning) = listing.warning(camera)
            {
                self.has_told_unread[index] = true;
                (self.tell)(&warning);
            }
            for name in listing.files {
                if self.done.contains(&name) {
                    done.insert(name);
                    continue;
                }
                let key = (numbers_padded(&name), name);
                if self.last.as_ref().is_some_and(|last| key <= *last) {
                    let reason = "came after a later frame set was returned; skipped";
                    (self.tell)(&InputError::file(&camera.join(&key.1), reason));
                    self.done.insert(key.1.clone());
                    done.insert(key.1);
                    continue;
                }
                // A file that is gone again was temporary.
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

    /// Reads the frame set of this name, from the cameras whose file exists.
    fn read(&mut self, name: &str, files: &[Option<Seen>]) -> Result<FrameSet, InputError> {
        let cameras = self.cameras.iter().zip(files);
        let views = cameras.map(|(camera, seen)| match seen {
            Some(_) => read_single(&camera.join(name), self.size_px),
            None => Ok(Picture::Eight(Image::missing())),
        });
        let views = views.collect::<Result<Vec<_>, _>>()?;
        self.depth_bits = bits_in_use(&views, self.depth_bits);
        let images = views.into_iter().map(|view| view.scaled(self.depth_bits));
        Ok(FrameSet {
            time_us: self.settings.period_us.saturating_mul(self.taken),
            images: images.collect(),
        })
    }
}

/// Reads a file of one image.
fn read_single(file: &Path, size_px: [u32; 2]) -> Result<Picture, InputError> {
    match layout::is_stack(file) {
        true => Err(InputError::file(file, WHOLE)),
        false => read_deep(file, size_px),
    }
}

impl<T: FnMut(&InputError)> Iterator for Watch<T> {
    type Item = Result<FrameSet, InputError>;

    fn next(&mut self) -> Option<Self::Item> {
        // The time that the caller took for the last frame set does not count as idle.
        self.changed = Instant::now();
        while !self.over && !self.settings.stop.load(Relaxed) {
            let now = Instant::now();
            // A long listing takes time, so it serves all frame sets that wait in it.
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

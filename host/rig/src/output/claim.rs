//! Claim on a file that grows during a run: an advisory lock, which the system releases when the
//! file is closed and after a crash.
//!
//! A new file takes the place of the old one by renaming. So the old one is locked until the new
//! one, which is locked already, is in its place: two runs that begin at the same time cannot both
//! succeed.

use std::fs::{self, File, Metadata, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// Lock on the file that is at a place before its successor.
pub(super) struct Claim {
    target: PathBuf,
    _file: File,
    /// True if an empty file was made only for the lock.
    is_new: bool,
}

impl Claim {
    /// Locks the file at `target`; makes an empty one if there is none.
    ///
    /// # Errors
    /// [`io::ErrorKind::ResourceBusy`] if another run has it; if the file cannot be opened.
    pub fn take(target: &Path) -> io::Result<Self> {
        loop {
            let is_new = !target.exists();
            let mut options = OpenOptions::new();
            options.read(true).write(true).create(true).truncate(false);
            let file = options.open(target)?;
            lock(&file)?;
            // Another run may have put its own file there between the two.
            if is_same(&file.metadata()?, &fs::metadata(target)?) {
                return Ok(Self {
                    target: target.to_owned(),
                    _file: file,
                    is_new,
                });
            }
        }
    }

    /// Ends the claim, once the successor is in its place.
    pub fn done(mut self) {
        self.is_new = false;
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        if self.is_new {
            let _ = fs::remove_file(&self.target);
        }
    }
}

/// Returns true if a run streams to the file at `target`.
pub(super) fn is_claimed(target: &Path) -> bool {
    let file = File::open(target);
    file.is_ok_and(|file| matches!(lock(&file), Err(cause) if is_busy(&cause)))
}

fn is_busy(cause: &io::Error) -> bool {
    cause.kind() == io::ErrorKind::ResourceBusy
}

/// Locks an open file. A file system without locks gives none.
///
/// # Errors
/// [`io::ErrorKind::ResourceBusy`] if another run has the lock.
#[cfg(unix)]
pub(super) fn lock(file: &File) -> io::Result<()> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(io::ErrorKind::ResourceBusy.into()),
        Ok(()) | Err(TryLockError::Error(_)) => Ok(()),
    }
}

/// Locks nothing: where locks are not advisory, other programs could not read the file.
#[cfg(not(unix))]
pub(super) fn lock(_: &File) -> io::Result<()> {
    Ok(())
}

#[cfg(unix)]
fn is_same(a: &Metadata, b: &Metadata) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn is_same(_: &Metadata, _: &Metadata) -> bool {
    true
}

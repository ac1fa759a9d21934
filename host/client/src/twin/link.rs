//! Symbolic link under which a simulated station is found, and the lock beside it, which tells a
//! link in use from one that a crash has left behind.

use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// Lock on a link's name; released when it is dropped, or by the system after a crash.
#[derive(Debug)]
pub struct LinkLock {
    _file: File,
    link: PathBuf,
}

impl LinkLock {
    /// Takes the lock.
    ///
    /// # Errors
    /// [`io::ErrorKind::ResourceBusy`] if another program has it.
    pub fn take(link: &Path) -> io::Result<Self> {
        let file = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(lock_of(link))?;
        if file.try_lock().is_err() {
            return Err(io::ErrorKind::ResourceBusy.into());
        }
        Ok(Self {
            _file: file,
            link: link.to_owned(),
        })
    }
}

impl Drop for LinkLock {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(lock_of(&self.link));
    }
}

/// Returns true if a program has the lock of this link, whether or not the link is there.
pub fn is_locked(link: &Path) -> bool {
    let lock = File::open(lock_of(link)).map(|lock| lock.try_lock_shared());
    matches!(lock, Ok(Err(TryLockError::WouldBlock)))
}

/// Returns true if the program that has made this link has crashed: its lock is free.
pub fn is_left_behind(link: &Path) -> bool {
    let lock = File::open(lock_of(link)).map(|lock| lock.try_lock_shared());
    link.is_symlink() && matches!(lock, Ok(Ok(())))
}

fn lock_of(link: &Path) -> PathBuf {
    let mut path = link.as_os_str().to_owned();
    path.push(".lock");
    path.into()
}

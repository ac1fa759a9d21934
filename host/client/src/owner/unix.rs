//! Sockets in the user's own folder.

use std::io;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

/// Connection between owner and guest.
pub(crate) type Stream = UnixStream;

/// Socket of an owner; removed when it is dropped.
#[derive(Debug)]
pub(crate) struct Listener {
    listener: UnixListener,
    path: PathBuf,
    /// Number of the socket's file.
    inode: u64,
}

impl Listener {
    /// Listens at `path`. Whoever calls this has the port, so a socket that lies there is left over
    /// from a crash.
    pub fn bind(path: &Path) -> io::Result<Self> {
        match std::fs::remove_file(path) {
            Err(cause) if cause.kind() != io::ErrorKind::NotFound => return Err(cause),
            _ => {}
        }
        let listener = UnixListener::bind(path)?;
        listener.set_nonblocking(true)?;
        Ok(Self {
            listener,
            path: path.to_owned(),
            inode: path.symlink_metadata()?.ino(),
        })
    }

    /// Returns the next guest, or [`io::ErrorKind::WouldBlock`] at once if there is none.
    pub fn accept(&self) -> io::Result<Stream> {
        self.listener.accept().map(|(stream, _)| stream)
    }

    /// Checks nothing: only this user can enter the folder of the socket.
    pub fn check(&self, _: &mut Stream) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        // A later owner may have put its own socket there. One that stays behind does no harm.
        let there = self.path.symlink_metadata();
        if there.is_ok_and(|there| there.ino() == self.inode) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Connects to an owner's socket.
pub(crate) fn connect(path: &Path) -> io::Result<Stream> {
    UnixStream::connect(path)
}

/// Returns the folder: within `/run/user/UID` where the system makes that, else within `/tmp`. It
/// does not depend on the environment, which may differ between an owner and its guests.
pub(super) fn folder() -> io::Result<PathBuf> {
    let user = rustix::process::geteuid().as_raw();
    let run = PathBuf::from(format!("/run/user/{user}"));
    let folder = match is_own(&run, user) {
        true => run.join("trinocular"),
        false => PathBuf::from(format!("/tmp/trinocular-{user}")),
    };
    match std::fs::DirBuilder::new().mode(0o700).create(&folder) {
        Err(cause) if cause.kind() != io::ErrorKind::AlreadyExists => return Err(cause),
        _ => {}
    }
    match is_own(&folder, user) {
        true => Ok(folder),
        false => Err(io::Error::new(
            io::ErrorKind::PermissionDenied,
            format!(
                "{} is not a folder that only this user can enter",
                folder.display()
            ),
        )),
    }
}

/// Returns true for a folder, and no link to one, that only this user can enter.
fn is_own(folder: &Path, user: u32) -> bool {
    let about = folder.symlink_metadata();
    about.is_ok_and(|about| about.is_dir() && about.uid() == user && about.mode() & 0o077 == 0)
}

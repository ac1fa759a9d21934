//! Target of an output path: a regular file, or a place that is written directly.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use super::open_existing;
use super::staged::{Staged, folder};

/// Largest number of links followed before they count as a circle, as on Linux.
const MOST_LINKS: usize = 40;

/// Place that will be written.
#[derive(Debug)]
pub(super) enum Place {
    /// A regular file, which may not exist yet; the path does not end in a link.
    File(PathBuf),
    /// A pipe or a device.
    Stream(File),
    /// Standard output.
    Output,
    /// Standard error.
    Error,
}

impl Place {
    /// Follows the links at `path` and opens their target.
    pub fn open(path: &Path) -> io::Result<Self> {
        let mut target = path.to_owned();
        for _ in 0..MOST_LINKS {
            match descriptor(&target) {
                // A second descriptor of the same file would overwrite the output of the first.
                Some(1) => return Ok(Self::Output),
                Some(2) => return Ok(Self::Error),
                Some(_) => return append(&target).map(Self::Stream),
                None => {}
            }
            let Ok(next) = fs::read_link(&target) else {
                return Self::at(target);
            };
            target = folder(&target).join(next);
        }
        Err(io::Error::other("too many symbolic links"))
    }

    fn at(target: PathBuf) -> io::Result<Self> {
        let about = match fs::metadata(&target) {
            Ok(about) => about,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                let folder = folder(&target);
                if !folder.is_dir() {
                    let reason = format!("no such folder: {}", folder.display());
                    return Err(io::Error::new(error.kind(), reason));
                }
                return Self::file(&target);
            }
            Err(error) => return Err(error),
        };
        if about.is_file() {
            open_existing(&target)?;
            return Self::file(&target);
        }
        special(&target, &about).map(Self::Stream)
    }

    fn file(target: &Path) -> io::Result<Self> {
        // Fail now if the file could not be created later.
        Staged::write(target, b"")?;
        let name = target.file_name().unwrap_or_default();
        // Give one file one name, for every spelling of its folder.
        Ok(Self::File(fs::canonicalize(folder(target))?.join(name)))
    }

    /// Writes all of `bytes`, unless the place is a regular file, which a [`Staged`] file replaces.
    pub fn write_in_place(&self, bytes: &[u8]) -> io::Result<()> {
        let write = |stream: &mut dyn io::Write| {
            stream.write_all(bytes)?;
            stream.flush()
        };
        match self {
            Self::File(_) => Ok(()),
            Self::Stream(file) => write(&mut &*file),
            Self::Output => write(&mut io::stdout().lock()),
            Self::Error => write(&mut io::stderr().lock()),
        }
    }
}

/// Returns the number of this program's descriptor that the path names: 1 for `/dev/stdout`.
fn descriptor(path: &Path) -> Option<u32> {
    let number = path.file_name()?.to_str()?.parse().ok()?;
    let folder = fs::canonicalize(folder(path)).ok()?;
    let own = fs::canonicalize("/dev/fd").ok()?;
    (folder == own).then_some(number)
}

fn append(path: &Path) -> io::Result<File> {
    fs::OpenOptions::new().append(true).open(path)
}

/// Opens a file that is not a regular one.
#[cfg(unix)]
fn special(path: &Path, about: &fs::Metadata) -> io::Result<File> {
    use std::os::unix::fs::FileTypeExt as _;
    let kind = about.file_type();
    if kind.is_char_device() {
        open_existing(path)
    } else if kind.is_fifo() {
        pipe(path)
    } else {
        let what = match about.is_dir() {
            true => "is a folder",
            false => "is no file that can be written",
        };
        Err(io::Error::other(what))
    }
}

#[cfg(not(unix))]
fn special(_: &Path, about: &fs::Metadata) -> io::Result<File> {
    let what = match about.is_dir() {
        true => "is a folder",
        false => "is no file that can be written",
    };
    Err(io::Error::other(what))
}

/// Opens a named pipe that another program reads; waits up to 5 s for that program. A plain open
/// would block until it comes.
#[cfg(unix)]
fn pipe(path: &Path) -> io::Result<File> {
    use rustix::fs::OFlags;
    use std::os::unix::fs::OpenOptionsExt as _;
    use std::time::Duration;
    const PATIENCE: Duration = Duration::from_secs(5);
    const LOOK: Duration = Duration::from_millis(20);
    let mut looks = PATIENCE.as_millis() / LOOK.as_millis();
    loop {
        let mut options = fs::OpenOptions::new();
        let flags = OFlags::NONBLOCK.bits() as i32;
        match options.write(true).custom_flags(flags).open(path) {
            // There is a reader, so that opening it once more does not wait, but writing does.
            Ok(_reader_is_there) => return open_existing(path),
            Err(error) if error.raw_os_error() != Some(rustix::io::Errno::NXIO.raw_os_error()) => {
                return Err(error);
            }
            Err(error) if looks == 0 => {
                let reason = "no program reads from this pipe";
                return Err(io::Error::new(error.kind(), reason));
            }
            Err(_) => looks -= 1,
        }
        std::thread::sleep(LOOK);
    }
}

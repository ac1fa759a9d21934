//! A complete new version of a file beside it, until it takes its place.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile, TempPath};

use super::claim::{Claim, lock};
use crate::interruption::Hold;

/// A complete file under a temporary name; dropping this value removes it.
pub(super) struct Staged {
    target: PathBuf,
    temporary: TempPath,
    /// Holds signals back until the file is in its place or removed.
    _hold: Hold,
}

impl Staged {
    /// Writes the new version of `target`, with the owner and the mode of an existing file.
    pub fn write(target: &Path, bytes: &[u8]) -> io::Result<Self> {
        fits_limit(bytes.len())?;
        let hold = Hold::begin();
        let before = fs::metadata(target).ok();
        // From here on an error removes the file.
        let mut staged = create_beside(target, before.is_some())?;
        let file = staged.as_file_mut();
        if let Some(before) = before {
            keep_access(file, &before)?;
        }
        file.write_all(bytes)?;
        file.sync_all()?;
        Ok(Self {
            target: target.to_owned(),
            temporary: staged.into_temp_path(),
            _hold: hold,
        })
    }
}

/// Puts a new, empty file in the place of `target`, with the owner and the mode of an existing file,
/// and returns it for writing, locked.
///
/// # Errors
/// [`io::ErrorKind::ResourceBusy`] if another run has begun this file and not closed it.
pub(super) fn begin(target: &Path) -> io::Result<File> {
    let claim = Claim::take(target)?;
    let staged = Staged::write(target, b"")?;
    let file = OpenOptions::new()
        .read(true)
        .write(true)
        .open(&staged.temporary)?;
    lock(&file)?;
    staged.temporary.persist(&staged.target)?;
    claim.done();
    Ok(file)
}

/// Puts all files in their places or, on any error, none.
///
/// # Errors
/// Returns the path of the file that could not be put in place.
pub(super) fn commit(staged: Vec<(&PathBuf, Staged)>) -> Result<(), (PathBuf, io::Error)> {
    let _hold = Hold::begin();
    let is_single = staged.len() == 1;
    let mut done: Vec<Undo> = Vec::new();
    for (path, file) in staged {
        let backup = match is_single {
            true => Ok(None),
            false => backup(&file.target),
        };
        let placed = backup.and_then(|backup| {
            file.temporary.persist(&file.target)?;
            let target = file.target;
            done.push(Undo { target, backup });
            Ok(())
        });
        if let Err(cause) = placed {
            done.into_iter().rev().for_each(Undo::restore);
            return Err((path.clone(), cause));
        }
    }
    Ok(())
}

/// A file in its place, and the one that it replaced.
struct Undo {
    target: PathBuf,
    /// Second name of the replaced file; dropping it removes this name.
    backup: Option<TempPath>,
}

impl Undo {
    fn restore(self) {
        let _ = match self.backup {
            Some(backup) => backup.persist(&self.target).map_err(io::Error::from),
            None => fs::remove_file(&self.target),
        };
    }
}

/// Gives the file a second name if it exists.
fn backup(target: &Path) -> io::Result<Option<TempPath>> {
    if !target.exists() {
        return Ok(None);
    }
    let linked = temporary().make_in(folder(target), |backup| fs::hard_link(target, backup))?;
    Ok(Some(linked.into_temp_path()))
}

/// Returns the folder that holds `path`.
pub(super) fn folder(path: &Path) -> &Path {
    match path.parent() {
        // The parent of a bare name is the empty path: the current folder.
        Some(parent) if parent.as_os_str().is_empty() => Path::new("."),
        Some(parent) => parent,
        None => path,
    }
}

/// Names of temporary files. They are independent of the file's own name, which may have the
/// maximum length.
fn temporary() -> Builder<'static, 'static> {
    let mut names = Builder::new();
    names.prefix(".trinocular-").suffix(".tmp");
    names
}

/// Creates a new file in the folder of `path`, so that renaming stays on one file system. If it
/// `is_private`, only its owner may read it for now.
fn create_beside(path: &Path, is_private: bool) -> io::Result<NamedTempFile> {
    if path.file_name().is_none() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "names no file"));
    }
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    if is_private {
        use std::os::unix::fs::OpenOptionsExt as _;
        options.mode(0o600);
    }
    #[cfg(not(unix))]
    let _ = is_private;
    temporary().make_in(folder(path), |temporary| options.open(temporary))
}

#[cfg(unix)]
fn keep_access(file: &File, before: &Metadata) -> io::Result<()> {
    use std::os::unix::fs::{MetadataExt as _, fchown};
    let now = file.metadata()?;
    if [now.uid(), now.gid()] != [before.uid(), before.gid()] {
        // Only the superuser may give files away; whoever may write the folder may replace them.
        let _ = fchown(file, Some(before.uid()), Some(before.gid()));
    }
    file.set_permissions(before.permissions())
}

#[cfg(not(unix))]
fn keep_access(file: &File, before: &Metadata) -> io::Result<()> {
    file.set_permissions(before.permissions())
}

/// Refuses a length above the file size limit of this process, because the system would end the
/// process in the middle.
#[cfg(unix)]
fn fits_limit(length: usize) -> io::Result<()> {
    let limit = rustix::process::getrlimit(rustix::process::Resource::Fsize).current;
    match limit {
        Some(limit) if length as u64 > limit => Err(io::Error::new(
            io::ErrorKind::FileTooLarge,
            format!("{length} bytes, but this process may write {limit} (ulimit -f)"),
        )),
        _ => Ok(()),
    }
}

#[cfg(not(unix))]
fn fits_limit(_: usize) -> io::Result<()> {
    Ok(())
}

//! A complete new version of a file beside it, until it takes its place.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use crate::interruption::Hold;

/// A complete file under a temporary name; dropping this value removes it.
pub(super) struct Staged {
    target: PathBuf,
    temporary: PathBuf,
    /// Holds signals back until the file is in its place or removed.
    _hold: Hold,
}

impl Staged {
    /// Writes the new version of `target`, with the owner and the mode of an existing file.
    pub fn write(target: &Path, bytes: &[u8]) -> io::Result<Self> {
        fits_limit(bytes.len())?;
        let hold = Hold::begin();
        let before = fs::metadata(target).ok();
        let (mut file, temporary) = create_beside(target, before.is_some())?;
        let target = target.to_owned();
        // From here on an error removes the file.
        let staged = Self {
            target,
            temporary,
            _hold: hold,
        };
        if let Some(before) = before {
            keep_access(&file, &before)?;
        }
        file.write_all(bytes)?;
        file.sync_all()?;
        Ok(staged)
    }

    fn take_place(&self) -> io::Result<()> {
        fs::rename(&self.temporary, &self.target)
    }
}

impl Drop for Staged {
    fn drop(&mut self) {
        // After the rename there is no file to remove; before it, an earlier error is reported.
        let _ = fs::remove_file(&self.temporary);
    }
}

/// Puts a new, empty file in the place of `target`, with the owner and the mode of an existing file,
/// and returns it for writing.
pub(super) fn begin(target: &Path) -> io::Result<File> {
    let staged = Staged::write(target, b"")?;
    let file = OpenOptions::new()
        .read(true)
        .write(true)
        .open(&staged.temporary)?;
    staged.take_place()?;
    Ok(file)
}

/// Puts all files in their places or, on any error, none.
///
/// # Errors
/// Returns the path of the file that could not be put in place.
pub(super) fn commit(staged: Vec<(&PathBuf, Staged)>) -> Result<(), (PathBuf, io::Error)> {
    let is_single = staged.len() == 1;
    let mut done: Vec<Undo> = Vec::new();
    for (path, file) in &staged {
        let backup = match is_single {
            true => Ok(None),
            false => backup(&file.target),
        };
        let placed = backup.and_then(|backup| {
            let target = &file.target;
            // Push first, so that the backup is removed in any case.
            let mut undo = Undo {
                target,
                backup,
                is_placed: false,
            };
            let renamed = file.take_place();
            undo.is_placed = renamed.is_ok();
            done.push(undo);
            renamed
        });
        if let Err(cause) = placed {
            done.iter().rev().for_each(Undo::restore);
            return Err(((*path).clone(), cause));
        }
    }
    Ok(())
}

/// Restores a replaced file.
struct Undo<'a> {
    target: &'a Path,
    /// Second name of the replaced file.
    backup: Option<PathBuf>,
    is_placed: bool,
}

impl Undo<'_> {
    fn restore(&self) {
        let _ = match &self.backup {
            _ if !self.is_placed => Ok(()),
            Some(backup) => fs::rename(backup, self.target),
            None => fs::remove_file(self.target),
        };
    }
}

impl Drop for Undo<'_> {
    fn drop(&mut self) {
        if let Some(backup) = &self.backup {
            let _ = fs::remove_file(backup);
        }
    }
}

/// Gives the file a second name if it exists.
fn backup(target: &Path) -> io::Result<Option<PathBuf>> {
    if !target.exists() {
        return Ok(None);
    }
    unused(target, |backup| fs::hard_link(target, backup)).map(|((), backup)| Some(backup))
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

/// Creates a new file in the folder of `path`, so that renaming stays on one file system. If it
/// `is_private`, only its owner may read it for now.
fn create_beside(path: &Path, is_private: bool) -> io::Result<(File, PathBuf)> {
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
    unused(path, |temporary| options.open(temporary))
}

/// Returns the result of `make` and the name it was made under: a new name beside `path`.
fn unused<T>(path: &Path, make: impl Fn(&Path) -> io::Result<T>) -> io::Result<(T, PathBuf)> {
    for attempt in 0..100_u32 {
        // The name is independent of the file's own, which may have the maximum length.
        let name = format!(".trinocular-{}-{attempt}.tmp", std::process::id());
        let beside = folder(path).join(name);
        match make(&beside) {
            Ok(made) => return Ok((made, beside)),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
        }
    }
    let reason = "a hundred temporary files of this program are in the way";
    Err(io::Error::new(io::ErrorKind::AlreadyExists, reason))
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

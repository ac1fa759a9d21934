//! Reading of files that the user names: at most a stated number of bytes, and never from a device.
//!
//! Regular files and pipes of a process substitution (`<(command)`) or of `/dev/stdin` are read.
//! Directories, devices and named pipes are refused before they are opened, because opening a named
//! pipe waits for its writer, which may never come.

use std::collections::HashSet;
use std::fs::{self, File};
use std::io::Read as _;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use crate::error::InputError;

/// Largest length of a kind of file.
///
/// ```
/// use trinocular_rig::input::{Limit, text};
///
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("notes.txt");
/// std::fs::write(&path, "sixteen letters.")?;
/// let limit = |bytes| Limit { what: "a text", bytes };
/// assert_eq!(text(&path, limit(16))?, "sixteen letters.");
/// assert!(text(&path, limit(15)).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limit {
    /// Kind of file, with its article: `a rig file`.
    pub what: &'static str,
    /// Largest length, bytes.
    pub bytes: u64,
}

/// Largest number of files that are remembered as inputs; a recording may have more.
const MOST_REMEMBERED: usize = 100_000;

/// Regular files that this program has read.
static READ: Mutex<Option<HashSet<Identity>>> = Mutex::new(None);

/// Identity of a file, independent of its name: device, number, and time of creation, because a
/// number is used again.
#[cfg(unix)]
pub type Identity = (u64, u64, Option<std::time::SystemTime>);
/// Identity of a file.
#[cfg(not(unix))]
pub type Identity = std::path::PathBuf;

/// Returns the file that `path` leads to, through links.
pub fn identity(path: &Path) -> Option<Identity> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        let about = fs::metadata(path).ok()?;
        Some((about.dev(), about.ino(), about.created().ok()))
    }
    #[cfg(not(unix))]
    fs::canonicalize(path).ok()
}

/// Returns true if this program has read that file: an output would replace its own input.
pub fn was_read(file: &Identity) -> bool {
    let read = READ.lock().unwrap_or_else(PoisonError::into_inner);
    read.as_ref().is_some_and(|files| files.contains(file))
}

fn remember(path: &Path) {
    let mut read = READ.lock().unwrap_or_else(PoisonError::into_inner);
    let files = read.get_or_insert_default();
    if files.len() < MOST_REMEMBERED {
        files.extend(identity(path));
    }
}

/// Reads the file at `path`.
///
/// # Errors
/// [`InputError`] if the file cannot be read, is not a regular file, or is longer than `limit`.
pub fn bytes(path: &Path, limit: Limit) -> Result<Vec<u8>, InputError> {
    let unreadable = |cause| InputError::io(path, "read", &cause);
    let (file, about) = open_any(path)?;
    if about.len() > limit.bytes {
        return Err(too_long(path, limit));
    }
    let mut bytes = Vec::with_capacity(about.len() as usize);
    let mut file = file.take(limit.bytes + 1);
    file.read_to_end(&mut bytes).map_err(unreadable)?;
    if let Some(reason) = stand_in(&bytes) {
        return Err(InputError::file(path, reason));
    }
    match bytes.len() as u64 > limit.bytes {
        true => Err(too_long(path, limit)),
        false => Ok(bytes),
    }
}

/// Returns the reason why the content is not the file itself, if it stands in for a large file that
/// a version control system keeps elsewhere.
///
/// ```
/// use trinocular_rig::input::stand_in;
///
/// let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
/// assert!(stand_in(pointer).is_some_and(|reason| reason.contains("git lfs pull")));
/// assert_eq!(stand_in(b"image_size_px = [640, 480]"), None);
/// ```
pub fn stand_in(bytes: &[u8]) -> Option<&'static str> {
    const LFS: &[u8] = b"version https://git-lfs.github.com/spec/";
    const ANNEX: &[u8] = b"/annex/objects/";
    if bytes.starts_with(LFS) {
        return Some("a Git LFS pointer and not the file itself; fetch it with \"git lfs pull\"");
    }
    let reason = "a git-annex pointer and not the file itself; fetch it with \"git annex get\"";
    bytes.starts_with(ANNEX).then_some(reason)
}

/// Opens the file at `path`, which is read piece by piece: a recording may be longer than memory.
///
/// # Errors
/// [`InputError`] if the file cannot be opened or is not a regular file.
pub fn open(path: &Path) -> Result<File, InputError> {
    open_any(path).map(|(file, _)| file)
}

fn open_any(path: &Path) -> Result<(File, fs::Metadata), InputError> {
    let unreadable = |cause| InputError::io(path, "read", &cause);
    let about = fs::metadata(path).map_err(|cause| match path == Path::new("-") {
        true => InputError::file(path, "no such file; /dev/stdin is standard input"),
        false => unreadable(cause),
    })?;
    if let Some(kind) = unfit(path, &about) {
        return Err(InputError::file(
            path,
            format!("is no regular file, but {kind}"),
        ));
    }
    let file = File::open(path).map_err(unreadable)?;
    if about.is_file() {
        remember(path);
    }
    Ok((file, about))
}

/// Reads the text file at `path`.
///
/// # Errors
/// Those of [`bytes`], and an [`InputError`] with the line of the first bytes that are not UTF-8.
pub fn text(path: &Path, limit: Limit) -> Result<String, InputError> {
    let bytes = bytes(path, limit)?;
    refuse_utf16(path, &bytes)?;
    String::from_utf8(bytes).map_err(|error| {
        let valid = error.utf8_error().valid_up_to();
        not_utf8(path, error.as_bytes().get(..valid).unwrap_or_default())
    })
}

/// Refuses UTF-16 text, which some editors and spreadsheets write: it begins with a byte order mark
/// or has a zero in every second byte.
///
/// # Errors
/// [`InputError`] with the way out, if the text is UTF-16.
pub fn refuse_utf16(path: &Path, bytes: &[u8]) -> Result<(), InputError> {
    let is_utf16 = match bytes {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => true,
        [0, b, ..] | [b, 0, ..] => *b != 0,
        _ => false,
    };
    match is_utf16 {
        true => Err(InputError::line(
            path,
            1,
            "the text is UTF-16, not UTF-8 text; save the file anew with the encoding UTF-8",
        )),
        false => Ok(()),
    }
}

/// Returns the error of a file that is UTF-8 only as far as `before` goes.
pub fn not_utf8(file: &Path, before: &[u8]) -> InputError {
    let line = 1 + before.iter().filter(|&&byte| byte == b'\n').count();
    InputError::line(file, line, "not UTF-8 text")
}

fn too_long(path: &Path, limit: Limit) -> InputError {
    let size = match limit.bytes >> 20 {
        0 => format!("{} kB", limit.bytes >> 10),
        megabytes => format!("{megabytes} MB"),
    };
    InputError::file(
        path,
        format!("longer than {size}, the most that {} has", limit.what),
    )
}

/// Returns the kind of file that the path leads to, if this kind must not be read.
fn unfit(path: &Path, about: &fs::Metadata) -> Option<&'static str> {
    if about.is_dir() {
        return Some("a folder");
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt as _;
        let kind = about.file_type();
        // A pipe without a name has no path of its own; its link in /dev/fd is dangling.
        let has_name = || !path.starts_with("/dev/") && fs::canonicalize(path).is_ok();
        if kind.is_fifo() && has_name() {
            return Some("a named pipe");
        }
        if kind.is_char_device() || kind.is_block_device() {
            return Some("a device");
        }
        if kind.is_socket() {
            return Some("a socket");
        }
    }
    #[cfg(not(unix))]
    let _ = path;
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: Limit = Limit {
        what: "a test's file",
        bytes: 2048,
    };

    fn refused(path: &Path) -> String {
        bytes(path, LIMIT).unwrap_err().reason
    }

    #[test]
    fn file_is_read_up_to_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, vec![b'x'; 2048]).unwrap();
        assert_eq!(text(&path, LIMIT).unwrap().len(), 2048);
        fs::write(&path, vec![b'x'; 2049]).unwrap();
        let error = bytes(&path, LIMIT).unwrap_err();
        assert_eq!(error.file, path);
        assert_eq!(
            error.reason,
            "longer than 2 kB, the most that a test's file has"
        );
    }

    #[test]
    fn invalid_utf8_is_named_with_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, b"a\nb\xff").unwrap();
        assert_eq!(text(&path, LIMIT).unwrap_err().line, Some(2));
    }

    #[test]
    fn utf16_is_named_with_way_out() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        for big in [false, true] {
            for mark in ["\u{feff}", ""] {
                let units = format!("{mark}a = 1").encode_utf16().collect::<Vec<_>>();
                let bytes = units.iter().flat_map(|unit| match big {
                    true => unit.to_be_bytes(),
                    false => unit.to_le_bytes(),
                });
                fs::write(&path, bytes.collect::<Vec<u8>>()).unwrap();
                let error = text(&path, LIMIT).unwrap_err();
                assert!(error.reason.contains("save the file anew"), "{error}");
            }
        }
    }

    #[test]
    fn folder_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(refused(folder.path()), "is no regular file, but a folder");
    }

    #[cfg(unix)]
    #[test]
    fn devices_and_pipes_are_refused() {
        assert_eq!(
            refused(Path::new("/dev/zero")),
            "is no regular file, but a device"
        );
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.unwrap().success());
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&pipe, &link).unwrap();
        for path in [pipe, link] {
            assert_eq!(refused(&path), "is no regular file, but a named pipe");
        }
    }
}

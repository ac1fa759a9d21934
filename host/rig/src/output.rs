//! Output files that the user names: each is written whole or not at all, and no other file is
//! replaced.
//!
//! An [`Output`] is opened before the work that produces its text, so that an unwritable place is
//! refused at once.
//!
//! | What is there | What happens |
//! |---|---|
//! | nothing | a new file, written beside its place and then renamed into it |
//! | a regular file | the same, if [`Replace`] allows it; owner and mode stay |
//! | a symbolic link | what it leads to is written, the link stays |
//! | a pipe, a terminal, `/dev/null`, `/dev/stdout` | written in place |
//! | a folder, a disk, a socket | refused |
//! | a file to which another run streams | refused |
//! | a file that this run has read | refused, through links too, even with `--force` |
//!
//! Only a new version of a rig file may replace an input: the rig file of which it is a version.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use crate::error::InputError;
use crate::input::{self, Identity};

mod claim;
mod place;
mod staged;

use place::Place;
use staged::Staged;

/// Existing files that may be replaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Replace {
    /// No existing file.
    Nothing,
    /// Files of this program of one kind, and empty files.
    Own(OwnFile),
    /// Every regular file.
    Anything,
}

/// Kinds of files that this program writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OwnFile {
    /// HTML page with results.
    Report,
    /// SVG figure.
    Figure,
    /// MCAP file.
    Recording,
}

impl OwnFile {
    /// Returns the word for messages.
    const fn name(self) -> &'static str {
        match self {
            Self::Report => "report",
            Self::Figure => "figure",
            Self::Recording => "recording",
        }
    }

    /// Returns true if the file at `path` is of this kind and from this program, of any version,
    /// or empty.
    fn is_at(self, path: &Path) -> io::Result<bool> {
        const END: u64 = 256;
        /// Bytes of a recording up to the name of its library, and some more.
        const START: u64 = 64;
        let mut file = File::open(path)?;
        let length = file.metadata()?.len();
        let mark = match self {
            Self::Report => REPORT_MARK,
            Self::Figure => FIGURE_MARK,
            Self::Recording => {
                let mut start = Vec::new();
                file.take(START).read_to_end(&mut start)?;
                return Ok(length == 0 || is_recording(&start));
            }
        };
        file.seek(SeekFrom::Start(length.saturating_sub(END)))?;
        let mut end = Vec::new();
        file.take(END).read_to_end(&mut end)?;
        Ok(length == 0 || String::from_utf8_lossy(&end).contains(mark))
    }
}

impl Replace {
    /// Returns [`Replace::Anything`] if `force` is set, otherwise `self`.
    #[must_use]
    pub fn or_forced(self, force: bool) -> Self {
        if force { Self::Anything } else { self }
    }
}

/// A file that will be written.
///
/// ```
/// use trinocular_rig::output::{Output, Replace};
///
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("report.html");
/// Output::open(&path, Replace::Nothing)?.write("first")?;
/// // The file exists now, and may not be replaced.
/// assert!(Output::open(&path, Replace::Nothing).is_err());
/// assert_eq!(std::fs::read_to_string(&path)?, "first");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Output {
    /// Path as given by the user.
    path: PathBuf,
    place: Place,
    /// Input file that this output may replace.
    predecessor: Option<Identity>,
}

impl Output {
    /// Opens the file at `path` without changing it.
    ///
    /// # Errors
    /// If the file cannot be written, or exists and may not be replaced.
    pub fn open(path: &Path, replace: Replace) -> Result<Self, InputError> {
        Self::open_any(path, replace, None)
    }

    /// Opens `path` for a new version of the input `predecessor`, which it may replace. Otherwise
    /// like [`Output::open`].
    ///
    /// # Errors
    /// Like [`Output::open`].
    pub fn open_successor(
        path: &Path,
        replace: Replace,
        predecessor: &Path,
    ) -> Result<Self, InputError> {
        Self::open_any(path, replace, input::identity(predecessor))
    }

    fn open_any(
        path: &Path,
        replace: Replace,
        predecessor: Option<Identity>,
    ) -> Result<Self, InputError> {
        if path == Path::new("-") {
            let reason = "standard output has the results of this command already; name a file \
                          (`./-` is a file of this name)";
            return Err(InputError::file(path, reason));
        }
        let unwritable = |cause: io::Error| InputError::io(path, "write", &cause);
        let place = Place::open(path).map_err(unwritable)?;
        let opened = Self {
            path: path.to_owned(),
            place,
            predecessor,
        };
        opened.refuse_input()?;
        if let Place::File(target) = &opened.place
            && target.exists()
        {
            if claim::is_claimed(target) {
                return Err(in_use(path));
            }
            match replace {
                Replace::Anything => {}
                Replace::Own(kind) if kind.is_at(target).map_err(unwritable)? => {}
                Replace::Own(kind) => {
                    let kind = kind.name();
                    let reason = format!(
                        "exists, and is no {kind} of this program; give --force to replace it"
                    );
                    return Err(InputError::file(path, reason));
                }
                Replace::Nothing => {
                    let reason = "exists; give --force to overwrite it";
                    return Err(InputError::file(path, reason));
                }
            }
        }
        Ok(opened)
    }

    /// Refuses to replace a file that this run has read.
    fn refuse_input(&self) -> Result<(), InputError> {
        let Place::File(target) = &self.place else {
            return Ok(());
        };
        match input::identity(target) {
            Some(file) if input::was_read(&file) && self.predecessor.as_ref() != Some(&file) => {
                let reason = "is an input of this command, which would be lost; name another file";
                Err(InputError::file(&self.path, reason))
            }
            _ => Ok(()),
        }
    }

    /// Returns true if writing replaces a file.
    pub fn replaces_file(&self) -> bool {
        matches!(&self.place, Place::File(target) if target.exists())
    }

    /// Returns true if both outputs are the same file, so that one text would overwrite the other.
    pub fn is_same_file(&self, other: &Self) -> bool {
        matches!((&self.place, &other.place), (Place::File(a), Place::File(b)) if a == b)
    }

    /// Returns the path as given by the user.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Starts to write the file as a stream, for content that grows during a run. A new file takes
    /// the place of an existing one at once, so that the old content is gone as soon as the first
    /// byte of the new is written, and the two never mix.
    ///
    /// The file is locked until it is closed, so that no other run streams to it meanwhile. The
    /// system releases the lock of a program that crashes.
    ///
    /// # Errors
    /// If the file cannot be written, an existing file is then unchanged; if another run streams to
    /// it; if it is standard output or standard error.
    pub fn stream(self) -> Result<File, InputError> {
        self.refuse_input()?;
        let opened = match &self.place {
            Place::File(target) => staged::begin(target),
            Place::Stream(file) => file.try_clone(),
            Place::Output | Place::Error => Err(io::Error::other("not to a terminal; name a file")),
        };
        opened.map_err(|cause| match cause.kind() {
            io::ErrorKind::ResourceBusy => in_use(&self.path),
            _ => unwritten(&self.path, &cause),
        })
    }

    /// Writes the file.
    ///
    /// # Errors
    /// If the file cannot be written; an existing file is then unchanged.
    pub fn write(self, content: impl AsRef<[u8]>) -> Result<(), InputError> {
        write_all(vec![(self, content)])
    }
}

/// Writes all of these files or, on any error, none. Text written in place cannot be taken back.
///
/// Ctrl-C and the other signals wait until the files are in their places; otherwise they could
/// leave temporary files, or old and new files side by side.
///
/// # Errors
/// If one of the files cannot be written.
pub fn write_all<C: AsRef<[u8]>>(outputs: Vec<(Output, C)>) -> Result<(), InputError> {
    // Files that were read since the outputs were opened are inputs, too.
    outputs
        .iter()
        .try_for_each(|(output, _)| output.refuse_input())?;
    let mut staged = Vec::new();
    for (output, content) in &outputs {
        if let Place::File(target) = &output.place {
            let ready = Staged::write(target, content.as_ref());
            staged.push((
                &output.path,
                ready.map_err(|cause| unwritten(&output.path, &cause))?,
            ));
        }
    }
    for (output, content) in &outputs {
        let written = output.place.write_in_place(content.as_ref());
        written.map_err(|cause| unwritten(&output.path, &cause))?;
    }
    staged::commit(staged).map_err(|(path, cause)| unwritten(&path, &cause))
}

fn in_use(path: &Path) -> InputError {
    let reason = "another run writes this file at present; end that run, or name another file";
    InputError::file(path, reason)
}

fn unwritten(path: &Path, cause: &io::Error) -> InputError {
    InputError::io(path, "write", cause)
}

/// Marks near the end of this program's own pages and figures.
const REPORT_MARK: &str = "<footer>Trinocular ";
const FIGURE_MARK: &str = "<!-- Trinocular ";

/// Returns the figure with the mark of this program.
pub fn marked(svg: &str) -> String {
    let version = env!("CARGO_PKG_VERSION");
    format!("{}\n{FIGURE_MARK}{version} -->\n", svg.trim_end())
}

/// Library that recordings of this program name at their start.
pub const RECORDING_LIBRARY: &str = concat!("trinocular ", env!("CARGO_PKG_VERSION"));

/// Returns true if the start of a file is that of a recording of this program, of any version.
fn is_recording(start: &[u8]) -> bool {
    let name = b"trinocular ";
    start.starts_with(b"\x89MCAP0\r\n") && start.windows(name.len()).any(|part| part == name)
}

/// Folders created for output; those that stay empty are removed when it is dropped.
#[derive(Debug, Default)]
pub struct NewFolders(Vec<PathBuf>);

impl NewFolders {
    /// Creates `dir` and its missing parent folders.
    ///
    /// # Errors
    /// If the folders cannot be created.
    pub fn make(&mut self, dir: &Path) -> Result<(), InputError> {
        if dir == Path::new("-") {
            let reason = "several files cannot go to standard output; name a folder (`./-` is a \
                          folder of this name)";
            return Err(InputError::file(dir, reason));
        }
        let missing = dir
            .ancestors()
            .take_while(|folder| !folder.as_os_str().is_empty() && !folder.exists());
        let missing: Vec<PathBuf> = missing.map(Path::to_owned).collect();
        self.0.splice(0..0, missing);
        fs::create_dir_all(dir).map_err(|cause| InputError::io(dir, "make the folder", &cause))
    }
}

impl Drop for NewFolders {
    /// Removes the folders that have stayed empty.
    fn drop(&mut self) {
        for folder in &self.0 {
            let _ = fs::remove_dir(folder);
        }
    }
}

/// Opens an existing file for writing; a read-only file stays read-only.
fn open_existing(path: &Path) -> io::Result<File> {
    OpenOptions::new().write(true).open(path)
}

#[cfg(test)]
mod tests;
